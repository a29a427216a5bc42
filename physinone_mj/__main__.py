"""The command line: `physinone`, or `python -m physinone_mj`."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import __version__
from .terminal import (
    OF_ONE_SCENE,
    BadInput,
    Progress,
    complain,
    names,
    say,
    say_json,
    say_laws,
    say_stress,
    say_trade,
    span,
    table,
    told,
)

if TYPE_CHECKING:
    from .base import Phenomenon
    from .dataset import Job, Report
    from .fidelity import Fidelity
    from .registry import Entry


@contextlib.contextmanager
def as_typed() -> Iterator[None]:
    """What the body finds wrong with its values was typed by the user."""
    try:
        yield
    except ValueError as why:
        raise BadInput(str(why)) from None


def chosen(words: Sequence[str]) -> list[Entry]:
    """The phenomena meant by indices, labels and ranges ("46", "SimplePendulum", "1-3 10"), in that order."""
    from .registry import entries, find

    found: list[Entry] = []
    for word in re.split(r"[\s,]+", " ".join(words).strip()):
        span = re.fullmatch(r"(\d+)-(\d+)", word)
        if span:
            low, high = int(span[1]), int(span[2])
            within = [entry for entry in entries() if low <= entry.index <= high]
            if not within:
                there = ", ".join(str(entry.index) for entry in entries())
                raise BadInput(f"no phenomenon in {word}; there are: {there}")
            found += within
        else:
            found.append(find(word))
    return list(dict.fromkeys(found))


def settings(assignments: Sequence[str], cls: type[Phenomenon]) -> dict[str, float | int | str]:
    """`name=value` each, as the phenomenon declares them: numbers, or the words of a choice."""
    from .base import Choice

    values: dict[str, float | int | str] = {}
    for assignment in assignments:
        name, sign, word = (part.strip() for part in assignment.partition("="))
        if not (name and sign and word):
            raise BadInput(f"--set {assignment!r}; allowed: name=value, such as --set length=0.7")
        declared, _ = cls.declarations().get(name, (None, None))
        values[name] = word if isinstance(declared, Choice) else number(word)
    return values


def number(word: str) -> float | int | str:
    """The word as a number, if it is one."""
    try:
        value = float(word)
    except ValueError:
        return word
    return int(word) if re.fullmatch(r"[+-]?\d{1,15}", word) else value


def paths(renderer: str, samples: int | None) -> int:
    """Paths of light per pixel that were asked for; 0 for the rasteriser."""
    if renderer not in ("raster", "photoreal"):
        raise BadInput(f"--renderer {renderer!r}; allowed: raster, photoreal")
    if renderer == "raster":
        if samples is not None:
            raise BadInput(f"--samples {samples} with --renderer raster; allowed: with --renderer photoreal")
        return 0
    if samples is not None and samples < 1:
        raise BadInput(f"--samples {samples}; allowed: 1 to 65536")
    return SAMPLES if samples is None else samples


def fidelity_named(name: str) -> Fidelity:
    """The preset of that name."""
    from .fidelity import Fidelity

    with as_typed():
        return Fidelity.named(name)


SAMPLES = 16
"""Paths per pixel, unless asked for otherwise: few, but denoised."""

app = typer.Typer(
    name="physinone",
    help="Visual physics: simulate, verify, render and annotate everyday phenomena.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Which = Annotated[list[str], typer.Argument(metavar="N", help="Indices, labels, ranges: 46, SimplePendulum, 1-3.")]
Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="A scene folder.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Set a parameter; may be repeated.")]
FidelityName = Annotated[str, typer.Option("--fidelity", metavar="NAME", help="draft, standard or reference.")]


@app.callback(invoke_without_command=True)
def physinone(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """Visual physics: simulate, verify, render and annotate everyday phenomena."""
    if version:
        print(f"physinone {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command("list")
def list_(as_json: Json = False) -> None:
    """The phenomena there are."""
    from .registry import entries

    if as_json:
        say_json([{"index": e.index, "label": e.label, "domain": e.domain, "title": e.title} for e in entries()])
        return
    labels, domains = (max((len(getattr(e, key)) for e in entries()), default=0) for key in ("label", "domain"))
    for e in entries():
        print(f"{e.index:>3}  {e.label:<{labels}}  {e.domain:<{domains}}  {e.title}")


@app.command()
def show(which: Annotated[str, typer.Argument(metavar="N", help="Index or label.")], as_json: Json = False) -> None:
    """What a phenomenon can be set to, what is recorded of it and which laws it obeys."""
    from .base import Choice
    from .fidelity import PRESETS, measured
    from .registry import phenomenon

    cls = phenomenon(which)
    nominal = cls.make().values()
    presets = [preset.name for preset in PRESETS]
    stress = measured("stability").get(str(cls.index), {"parameters": {}})["parameters"]
    parameters: list[dict[str, Any]] = [
        {"name": name, "unit": param.unit, "nominal": nominal[name], "about": param.about}
        | ({"words": list(param.words)} if isinstance(param, Choice) else {"low": param.low, "high": param.high})
        | ({"trusted": stress[name]["trusted"]} if stress.get(name, {}).get("trusted") else {})
        for name, (param, _) in cls.declarations().items()
    ]
    observables = [{"name": o.name, "unit": o.unit, "about": o.about} for o in cls.observables().values()]
    laws: list[dict[str, Any]] = [
        {
            "name": law.name, "equation": law.equation, "source": law.source,
            "within": dict(zip(presets, law.within, strict=True)), "unit": law.unit, "limited_by": law.limited_by,
        }
        for law in cls.laws().values()
    ]  # fmt: skip
    if as_json:
        head = {"index": cls.index, "label": cls.label, "domain": cls.domain, "title": cls.title}
        say_json(head | {"parameters": parameters, "observables": observables, "laws": laws})
        return
    trusted = {preset: f"trusted at {preset}" for p in parameters for preset in p.get("trusted", ())}
    settable = table("parameter", "nominal", "low", "high", *trusted.values(), "unit", "about",
                     right=("nominal", "low", "high"))  # fmt: skip
    for p in parameters:
        low, high = (f"{p[k]:g}" for k in ("low", "high")) if "low" in p else ("", "")
        about = f"{p['about']}: {', '.join(p['words'])}" if "words" in p else p["about"]
        plain = f"{p['nominal']:g}" if "low" in p else p["nominal"]
        seen = (span(p["trusted"][preset]) if preset in p.get("trusted", ()) else "" for preset in trusted)
        settable.add_row(p["name"], plain, low, high, *seen, p["unit"], about)
    recorded = table("observable", "unit", "about")
    for o in observables:
        recorded.add_row(o["name"], o["unit"], o["about"])
    obeyed = table("law", "equation", *presets, "source", right=presets)
    notes = []
    for law in laws:
        unit = f" {law['unit']}" if law["unit"] else ""
        obeyed.add_row(law["name"], law["equation"], *(f"{w:.2g}{unit}" for w in law["within"].values()), law["source"])
        notes += [f"{law['name']}, limited by: {law['limited_by']}"] if law["limited_by"] else []
    say(f"{cls.index} {cls.label} ({cls.domain}): {cls.title}", settable, recorded, obeyed, *notes)


@app.command()
def run(
    which: Which,
    assignments: Set = None,
    sample: Annotated[bool, typer.Option("--sample", help="Draw what is not set at random, by the seed.")] = False,
    seed: Annotated[int, typer.Option(help="Cameras, and what --sample draws.")] = 0,
    fidelity: Annotated[
        str | None, typer.Option(metavar="NAME", help="draft, standard (if not given) or reference.")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Instead of --fidelity: the cheapest setting at which all laws err by less.")
    ] = None,
    views: Annotated[
        int | None, typer.Option(help="Static cameras (12; of deforming matter 15); a moving one comes on top.")
    ] = None,
    size: Annotated[int, typer.Option(help="Pixels per side.")] = 1120,
    modalities: Annotated[str, typer.Option(help="Some of rgb,depth,seg.")] = "rgb,depth,seg",
    renderer: Annotated[
        str, typer.Option(metavar="NAME", help="raster, or photoreal: path-traced colour (an extra; slow).")
    ] = "raster",
    samples: Annotated[int | None, typer.Option(help="With photoreal: paths per pixel; 16 if not given.")] = None,
    render: Annotated[bool, typer.Option("--render/--no-render", help="Whether to draw pictures.")] = True,
    particles: Annotated[
        bool, typer.Option("--particles/--no-particles", help="Whether to keep a continuum's particles.")
    ] = True,
    force: Annotated[bool, typer.Option("--force", help="Replace a scene that exists.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Where scenes go.")] = Path("out"),
    as_json: Json = False,
) -> None:
    """Make scenes: simulate, check the laws, render, annotate."""
    import numpy as np

    from .dataset import Job
    from .fidelity import cheapest
    from .registry import phenomenon

    jobs = []
    preset = fidelity_named(fidelity or "standard")
    if tolerance is not None and fidelity is not None:
        raise BadInput(f"--tolerance {tolerance} with --fidelity {fidelity}; allowed: one of the two")
    wanted = tuple(word.strip() for word in modalities.split(","))
    traced = paths(renderer, samples)
    for entry in chosen(which):
        cls = phenomenon(entry.index)
        values = settings(assignments or (), cls)
        with as_typed():
            seen = cls.views if views is None else views
            if tolerance is not None:
                expected = cheapest(entry.index, tolerance)
                preset = expected.fidelity
                print(f"{entry.index} {entry.label}: {preset.name}; expected: an error of {expected.error:.2g} "
                      f"({expected.law}), a cost of {expected.cost:.2g}", file=sys.stderr)  # fmt: skip
            job = Job(entry.index, values, preset, seed, seen, size, wanted, render, traced, particles)
        if sample:
            drawn = cls.sample(np.random.default_rng([seed, entry.index]), **values).values()
            job = dataclasses.replace(job, parameters=drawn)
        jobs.append(job)

    made: list[dict[str, Any]] = []
    missing = False
    try:
        for n, job in enumerate(jobs):
            try:
                made.append(make(job, output, force, n / len(jobs), 1 / len(jobs)))
            except Exception as failure:
                line = told(failure) if names(failure) & OF_ONE_SCENE else None
                if line is None:
                    raise
                complain(line)
                missing = True
            else:
                if not as_json:
                    say_laws(made[-1]["laws"])
                    print(made[-1]["folder"], flush=True)
    finally:
        # what was made is told even if the rest is not to be
        if as_json:
            say_json(made)
    if missing or any(law["passed"] is False for scene in made for law in scene["laws"]):
        raise typer.Exit(2 if missing else 1)


def make(job: Job, output: Path, force: bool, before: float, share: float) -> dict[str, Any]:
    """One scene, which is that `share` of the command, with a fraction `before` it already done; what to tell of it."""
    from .dataset import generate

    name = f"{job.index} {job.specimen.label}"
    with Progress(name) as progress:
        folder = generate(
            job, output, force=force, progress=lambda stage, done: progress(f"{name}: {stage}", before + share * done)
        )
    laws = json.loads((folder / "laws.json").read_text(encoding="utf-8"))
    return {"index": job.index, "label": job.specimen.label, "folder": str(folder), "laws": laws}


@app.command()
def check(
    which: Annotated[list[str] | None, typer.Argument(metavar="N", help="As for run; all when not given.")] = None,
    assignments: Set = None,
    fidelity: FidelityName = "standard",
    as_json: Json = False,
    report: Annotated[Path | None, typer.Option(help="Also write the table as Markdown to this file.")] = None,
) -> None:
    """Simulate and hold every law against what happened; exit code 1 if one fails."""
    from .checks import judge_all
    from .checks import report as page
    from .registry import entries, phenomenon

    meant = chosen(which) if which else list(entries())
    preset = fidelity_named(fidelity)
    tasks = []
    if report and not report.parent.is_dir():
        raise BadInput(f"--report {report}: no folder {report.parent}; allowed: a file in a folder that exists")
    for entry in meant:
        values: dict[str, Any] = {}
        if assignments:
            cls = phenomenon(entry.index)
            values = settings(assignments, cls)
            cls.make(**values)  # what cannot be shall be said before any work
        tasks.append((entry.index, values, preset))
    records, missing = [], []
    for laws, line in judge_all(tasks, [f"{entry.index} {entry.label}" for entry in meant]):
        records += laws
        missing += [line] if line else []
    if report:
        report.write_text(page(records, missing), encoding="utf-8")
    if as_json:
        say_json(records)
    else:
        say_laws(records)
    for line in missing:
        complain(line)
    if missing or any(record["passed"] is False for record in records):
        raise typer.Exit(2 if missing else 1)


@app.command()
def trade(
    which: Annotated[list[str] | None, typer.Argument(metavar="N", help="As for run; all when not given.")] = None,
    seed: Annotated[int, typer.Option(help="Of the random specimens.")] = 0,
    specimens: Annotated[int, typer.Option(help="Random specimens of each phenomenon, beside the nominal one.")] = 8,
    study: Annotated[bool, typer.Option("--study", help="Also try the engine's alternatives, for comparison.")] = False,
    records: Annotated[
        Path, typer.Option(metavar="FILE", help="What was measured, line by line; a run that is repeated goes on.")
    ] = Path("out/trade.jsonl"),
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables as Markdown.")] = None,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a row for each law and setting.")] = None,
    plots: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw error against cost, a PNG each (an extra: study).")
    ] = None,
    table_file: Annotated[
        Path | None, typer.Option("--table", metavar="FILE", help="Update the table that --tolerance reads (JSON).")
    ] = None,
    pictures: Annotated[
        int | None,
        typer.Option(metavar="PIXELS", help="Instead: image error of one picture of that size (an extra: study)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure error against cost: every law, from coarse settings to fine ones, over the parameters' ranges."""
    from . import trade as tool
    from .checks import read_journal
    from .registry import entries

    if not 0 <= specimens <= 10_000 or not 0 <= seed < 2**63:
        raise BadInput(f"--specimens {specimens} --seed {seed}; allowed: 0 to 10000, 0 to {2**63 - 1}")
    folders_exist(report=report, csv=csv, table=table_file)
    before = table_so_far(table_file)
    needed = {"--plots": (plots, "matplotlib"), "--pictures": (pictures, "skimage")}
    for option, (asked, module) in needed.items():
        if asked is not None and not importlib.util.find_spec(module):
            raise BadInput(f"{option} without {module}; allowed: after pip install 'physinone-mj[study]'")
    if plots:
        plots.mkdir(parents=True, exist_ok=True)
    meant = [entry.index for entry in (chosen(which) if which else entries())]
    if pictures is not None:
        compare_pictures(meant, pictures, report, as_json)
        return
    rungs = [(index, seed, number, study and number == 0) for number in range(specimens + 1) for index in meant]
    with as_typed():
        read_journal(records)
    table = tool.tabulate(tool.measure(rungs, records))
    write_tables(before, table, tool.page, table_file, report)
    if csv:
        write_csv(csv, tool.rows(table))
    for index, entry in table.items() if plots else ():
        tool.plot(entry, plots / f"{int(index):02d}_{entry['label']}.png")  # type: ignore[operator]
    if as_json:
        say_json(table)
    else:
        say_trade(table)
    complain_of(tool.problems(table))


def folders_exist(**files: Path | None) -> None:
    """BadInput unless every file that an option names can be written."""
    for name, file in files.items():
        if file and not file.parent.is_dir():
            raise BadInput(f"--{name} {file}: no folder {file.parent}; allowed: a file in a folder that exists")


def table_so_far(file: Path | None) -> dict[str, Any]:
    """What a file of --table says already; BadInput if it is none."""
    if file is None or not file.exists():
        return {}
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        table = None
    known = isinstance(table, dict) and all(i.isdecimal() and isinstance(entry, dict) for i, entry in table.items())
    if not known:
        raise BadInput(f"--table {file}: not a table by index; allowed: one of this command's, or a new file")
    return dict(table)


def write_tables(
    before: dict[str, Any], table: dict[str, Any], page: Callable[[dict[str, Any]], str], table_file: Path | None,
    report: Path | None,
) -> None:  # fmt: skip
    """Those that were asked for, with what the table said before of other phenomena."""
    from .checks import put_in_place

    table = dict(sorted((before | table).items(), key=lambda entry: int(entry[0])))
    if table_file:
        put_in_place(table_file, json.dumps(table, indent=1, ensure_ascii=False) + "\n")
    if report:
        put_in_place(report, page(table))


def complain_of(problems: Sequence[str]) -> None:
    """A line each, and exit code 1 if there are any."""
    for line in problems:
        complain(line)
    if problems:
        raise typer.Exit(1)


def compare_pictures(meant: Sequence[int], size: int, report: Path | None, as_json: bool) -> None:
    """Image error against cost of a picture of each phenomenon."""
    from . import pictures
    from .registry import phenomenon

    found, text = {}, "# Image error against cost\n\nGenerated by `physinone trade --pictures`; not to be edited.\n"
    for index in meant:
        label = phenomenon(index).label
        with as_typed(), Progress(f"{index} {label}"):
            found[index] = pictures.measure(index, size=size)
        text += "\n" + pictures.page(f"{index} {label}, {size} pixels", found[index])
        if not as_json:
            rows = table("picture", "setting", "PSNR [dB]", "SSIM", "cost", right=("PSNR [dB]", "SSIM", "cost"))
            for r in found[index]:
                rows.add_row(r["renderer"], r["setting"], f"{r['psnr']:.1f}", f"{r['ssim']:.4f}", f"{r['cost']:.2g}")
            say(f"{index} {label}", rows)
    if as_json:
        say_json(found)
    if report:
        report.write_text(text, encoding="utf-8")


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """One row each, with a header."""
    import csv

    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


@app.command()
def cost(
    which: Which,
    assignments: Set = None,
    fidelity: FidelityName = "standard",
    size: Annotated[int, typer.Option(help="Pixels per side.")] = 1120,
    render: Annotated[bool, typer.Option("--render/--no-render", help="Whether pictures count.")] = True,
    turns: Annotated[int, typer.Option(help="How often it is advanced with everything on, for the ratio.")] = 3,
    as_json: Json = False,
) -> None:
    """Measure where the time of a scene goes, what was left out of it, and what it costs with everything on."""
    from .dataset import Job
    from .registry import phenomenon
    from .terminal import say_cost

    if not 0 <= turns <= 100:
        raise BadInput(f"--turns {turns}; allowed: 0 to 100")
    preset = fidelity_named(fidelity)
    jobs = []
    for entry in chosen(which):
        cls = phenomenon(entry.index)
        with as_typed():
            jobs.append(Job(entry.index, settings(assignments or (), cls), preset, 0, cls.views, size, render=render))
    records: list[dict[str, Any]] = []
    missing = False
    try:
        for n, job in enumerate(jobs):
            try:
                records.append(priced(job, turns, n / len(jobs), 1 / len(jobs)))
            except Exception as failure:
                line = told(failure) if names(failure) & OF_ONE_SCENE else None
                if line is None:
                    raise
                complain(line)
                missing = True
            else:
                if not as_json:
                    say_cost(records[-1])
    finally:
        if as_json:
            say_json(records)
    if missing or any(record["problems"] for record in records):
        raise typer.Exit(2 if missing else 1)


def priced(job: Job, turns: int, before: float, share: float) -> dict[str, Any]:
    """What one scene costs; how far the command is as of `make`."""
    from .cost import measure

    name = f"{job.index} {job.specimen.label}"
    with Progress(name) as progress:
        return measure(
            job, turns=turns, progress=lambda stage, done: progress(f"{name}: {stage}", before + share * done)
        )


@app.command()
def stress(
    which: Annotated[list[str] | None, typer.Argument(metavar="N", help="As for run; all when not given.")] = None,
    seed: Annotated[int, typer.Option(help="Of the corners chosen and of the specimens in between.")] = 0,
    latin: Annotated[int, typer.Option(metavar="COUNT", help="Specimens in between: a Latin hypercube.")] = 8,
    fidelity: FidelityName = "standard",
    frontier: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Push ranges outwards at this fidelity (draft); may be repeated; or none."),
    ] = None,
    records: Annotated[
        Path, typer.Option(metavar="FILE", help="What was found, line by line; a run that is repeated goes on.")
    ] = Path("out/stress.jsonl"),
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables as Markdown.")] = None,
    table_file: Annotated[
        Path | None,
        typer.Option("--table", metavar="FILE", help="Update the table that `show` reads (JSON); frontiers are added."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Try every corner of the parameters' ranges, and beyond; exit code 1 if a range promises what does not hold."""
    from . import stress as tool
    from .checks import read_journal
    from .registry import entries

    if not 0 <= latin <= 10_000 or not 0 <= seed < 2**63:
        raise BadInput(f"--latin {latin} --seed {seed}; allowed: 0 to 10000, 0 to {2**63 - 1}")
    folders_exist(report=report, table=table_file)
    before = table_so_far(table_file)
    within = fidelity_named(fidelity).name
    pushed = [] if frontier == ["none"] else [fidelity_named(name).name for name in frontier or ["draft"]]
    meant = [entry.index for entry in (chosen(which) if which else entries())]
    todo = [task for index in meant for task in tool.tasks(index, seed, latin, within, pushed)]
    with as_typed():
        read_journal(records)
    table = tool.joined(before, tool.tabulate(tool.measure(todo, records)))
    write_tables(before, table, tool.page, table_file, report)
    if as_json:
        say_json(table)
    else:
        say_stress(table)
    complain_of(tool.problems(table))


@app.command()
def verify(folder: Folder, as_json: Json = False) -> None:
    """Check a scene folder: checksums, layout, the laws judged anew from what was recorded."""
    from . import dataset

    with Progress(f"verifying {folder}"):
        report = dataset.verify(folder)
    answer(report, as_json, "verified")


@app.command()
def reproduce(folder: Folder, as_json: Json = False) -> None:
    """Simulate a scene again from its provenance.json alone and compare bit for bit."""
    from . import dataset

    with Progress(f"reproducing {folder}") as progress:
        report = dataset.reproduce(folder, progress=progress)
    answer(report, as_json, "reproduced bit for bit")


def answer(report: Report, as_json: bool, praise: str) -> None:
    """Print what was found in a scene folder; exit code 1 unless all is well."""
    laws = [verdict.record() for verdict in report.verdicts]
    if as_json:
        say_json({"folder": str(report.folder), "ok": report.ok, "problems": report.problems, "laws": laws})
    else:
        if laws:
            say_laws(laws)
        for problem in report.problems:
            print(problem)
        print(f"{report.folder}: {praise if report.ok else 'not ' + praise}")
    if not report.ok:
        raise typer.Exit(1)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Whether this machine is ready, and the line to type where it is not."""
    from .doctor import examine

    findings = examine()
    if as_json:
        say_json([vars(finding) for finding in findings])
    else:
        width = max(len(finding.name) for finding in findings)
        for finding in findings:
            print(f"{'ok ' if finding.ok else 'ILL'}  {finding.name:<{width}}  {finding.value}")
            if finding.fix:
                print(f"     {'':<{width}}  {'better' if finding.ok else 'type'}: {finding.fix}")
    if not all(finding.ok for finding in findings):
        raise typer.Exit(1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Exit code: 0; 1 if a law or a check failed; 2 if it could not be done; 130 if stopped."""
    try:
        code = app(arguments, prog_name="physinone", standalone_mode=False)
        sys.stdout.flush()
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    except BrokenPipeError:
        # whoever read the output has enough of it; nor shall the interpreter complain when it flushes
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as failure:
        line = told(failure)
        if line is None:
            raise
        complain(line)
        return 2
    if code == 130:
        complain("stopped")
    return int(code or 0)


if __name__ == "__main__":
    sys.exit(main())
