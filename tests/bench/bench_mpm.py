"""How fast the continuum solver is, beside a textbook one: `python -m tests.bench.bench_mpm [FILE]`.

100,000 particles, eight to a cell, fall at 5 m/s, so that they are sorted anew every 28 steps or so, which is counted.
Both programs advance the same cloud in the same process, taking turns; the ratio is the median over the turns, so that
a busy machine slows both alike. Times are the processor's. The textbook is `textbook` in tests/bench/bench_mpm.py,
nobody else's program: one dense grid, cleared at every step, atomic additions, the deformation gradient, `ti.svd` where
a material is plastic. Targets, as ratios with one thread in single precision: 6 elastic and Newtonian, 5 plastic. The
ratio depends on the machine, as it is memory that the textbook waits for.

All of it runs on the CPU. Where Taichi is told to run on a GPU (TI_ARCH=cuda), particles and grid travel there and back
for every kernel; nobody has tried that, and no speed is claimed for it.

What a second thread brings is read off the clock, by processes of one and of two threads that take turns, the median of
their ratios; beside it what the machine can give, two processes of one thread each at the same time over one alone. The
target is 1.5 on two cores that nobody else uses. With a FILE, the tables go there, too.
"""

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from mpm_sidecar._ti import start, ti
from mpm_sidecar.transfer import Body, Solver
from physinone_mj.continuum import Elastic, Granular, Newtonian, Plasticine, Viscoplastic

from . import bench_viscosity

COUNT, TURNS, STEPS, DT = 100_000, 15, 28, 1e-4
MATERIALS = {
    "Elastic": Elastic(), "Newtonian": Newtonian(viscosity=10.0), "Plasticine": Plasticine(),
    "Viscoplastic": Viscoplastic(), "Granular": Granular(),
}  # fmt: skip
FLOPS = 1080
"""Of one elastic update: 450 scattered, 480 gathered, 150 of the law."""
HOME = Path(__file__).resolve().parents[2]
DEEP = 16
"""Multiplications and additions of a number that is at hand, where the roof of arithmetic is measured."""


def block(cells: int, count: int = COUNT) -> Any:
    """Points (count, 3) [m] of a cube in a world of so many cells, eight in each on average."""
    side = (count / 8) ** (1 / 3) / cells
    return np.random.default_rng(0).random((count, 3)) * side + (0.5 - side / 2, 0.5 - side / 2, 0.4)


def textbook(name: str, cells: int, double: bool) -> Callable[[], None]:
    """A step of the textbook, as a function."""
    real = ti.f64 if double else ti.f32
    material = MATERIALS[name]
    k = [*material.parameters(), 0.0, 0.0][:4]
    points = block(cells)
    n, dx, dt = len(points), 1 / cells, DT * 64 / cells
    volume = (dx / 2) ** 3
    mass = volume * material.density
    x, v = ti.Vector.field(3, real, n), ti.Vector.field(3, real, n)
    c, f, j = ti.Matrix.field(3, 3, real, n), ti.Matrix.field(3, 3, real, n), ti.field(real, n)
    momentum, weight = ti.Vector.field(3, real, (cells,) * 3), ti.field(real, (cells,) * 3)

    @ti.func
    def fluid(p):
        j[p] *= 1 + dt * c[p].trace()
        pressure = k[1] * (j[p] - 1 / j[p] ** 6)
        return pressure * ti.Matrix.identity(real, 3) + 0.5 * k[0] * j[p] * (c[p] + c[p].transpose())

    @ti.func
    def rubber(p):
        f[p] += dt * c[p] @ f[p]
        return k[0] * f[p] @ f[p].transpose() + (k[1] * ti.log(f[p].determinant()) - k[0]) * ti.Matrix.identity(real, 3)

    @ti.func
    def cut(e, _s):
        """Of plasticine."""
        shape = e - e.sum() / 3
        size = shape.norm(1e-12)
        return e - ti.max(size - k[2] / (2 * k[0]), 0) / size * shape

    @ti.func
    def slow(e, s):
        """Of paste."""
        shape = e - e.sum() / 3
        size = shape.norm(1e-12)
        beyond = ti.max(2 * k[0] * size - k[2], 0) / (1 + k[3] / (2 * k[0] * s.norm_sqr() / 3 * dt))
        return e - beyond / (2 * k[0] * size) * shape

    @ti.func
    def cone(e, _s):
        """Of sand."""
        shape = e - e.sum() / 3
        size = shape.norm(1e-12)
        kept = e - ti.max(size + k[2] * e.sum(), 0) / size * shape
        if e.sum() > 0:
            kept = ti.Vector.zero(real, 3)
        return kept

    def plastic(flow: Any) -> Any:
        @ti.func
        def respond(p):
            u, sigma, w = ti.svd(f[p] + dt * c[p] @ f[p])
            s = ti.Vector([ti.max(sigma[i, i], 0.05) for i in ti.static(range(3))])
            e = flow(ti.log(s), s)
            inner, stress = ti.Matrix.zero(real, 3, 3), ti.Matrix.zero(real, 3, 3)
            for i in ti.static(range(3)):
                inner[i, i] = ti.exp(e[i])
                stress[i, i] = 2 * k[0] * e[i] + k[1] * e.sum()
            f[p] = u @ inner @ w.transpose()
            return u @ stress @ u.transpose()

        return respond

    law = {"Elastic": rubber, "Newtonian": fluid}.get(name) or plastic(
        {"Plasticine": cut, "Viscoplastic": slow, "Granular": cone}[name]
    )

    @ti.func
    def stencil(p):
        base = ti.cast(x[p] / dx - 0.5, ti.i32)
        g = x[p] / dx - base
        return base, g, [0.5 * (1.5 - g) ** 2, 0.75 - (g - 1) ** 2, 0.5 * (g - 0.5) ** 2]

    @ti.kernel
    def clear():
        for node in ti.grouped(weight):
            momentum[node], weight[node] = ti.Vector.zero(real, 3), 0.0

    @ti.kernel
    def scatter():
        for p in range(n):
            base, g, w = stencil(p)
            a = mass * c[p] - (dt * volume * 4 / dx**2) * law(p)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                share = w[i][0] * w[j][1] * w[k][2]
                node = base + ti.Vector([i, j, k])
                momentum[node] += share * (mass * v[p] + a @ ((ti.Vector([i, j, k]) - g) * dx))
                weight[node] += share * mass

    @ti.kernel
    def advance():
        for node in ti.grouped(weight):
            if weight[node] > 0:
                momentum[node] = momentum[node] / weight[node]

    @ti.kernel
    def gather():
        for p in range(n):
            base, g, w = stencil(p)
            new, spin = ti.Vector.zero(real, 3), ti.Matrix.zero(real, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                share = w[i][0] * w[j][1] * w[k][2]
                here = momentum[base + ti.Vector([i, j, k])]
                new += share * here
                spin += (4 / dx * share) * here.outer_product(ti.Vector([i, j, k]) - g)
            v[p], c[p] = new, spin
            x[p] += dt * new

    x.from_numpy(points)
    v.from_numpy(np.tile([0.0, 0.0, -5.0], (n, 1)))
    f.from_numpy(np.tile(np.eye(3), (n, 1, 1)))
    j.fill(1.0)

    def step() -> None:
        clear()
        scatter()
        advance()
        gather()

    return step


def ours(name: str, cells: int, double: bool) -> Solver:
    """The solver with the same cloud."""
    volume = (0.5 / cells) ** 3
    return Solver([Body(MATERIALS[name], block(cells), volume, (0, 0, -5.0))], 1 / cells, double=double)


def child(double: bool, cells: int) -> dict[str, list[float]]:
    """Material: million updates per second, of the textbook, their ratio."""
    start(double, cpu_max_num_threads=1)
    rows = {}

    def rate(step: Callable[[], Any], steps: int) -> float:
        begun = time.process_time()
        for _ in range(steps):
            step()
        ti.sync()
        return COUNT * steps / (time.process_time() - begun) / 1e6

    for name in MATERIALS:
        solver, plain = ours(name, cells, double), textbook(name, cells, double)
        dt = DT * 64 / cells
        rate(lambda solver=solver, dt=dt: solver.step(dt), 2)  # type: ignore[misc]
        rate(plain, 2)
        turns = [(rate(lambda solver=solver, dt=dt: solver.step(dt), STEPS), rate(plain, 4)) for _ in range(TURNS)]  # type: ignore[misc]
        rows[name] = [max(a for a, _ in turns), max(b for _, b in turns), statistics.median(a / b for a, b in turns)]
    return rows


def turns(name: str, threads: int) -> None:
    """Seconds by the clock of STEPS steps, printed for each line that is read."""
    start(False, cpu_max_num_threads=threads)
    solver = ours(name, 64, False)
    for _ in range(2):
        solver.step(DT)
    print("ready", flush=True)
    for _ in sys.stdin:
        begun = time.perf_counter()
        for _ in range(STEPS):
            solver.step(DT)
        print(time.perf_counter() - begun, flush=True)


def two_threads(name: str) -> tuple[float, float, float]:
    """(million updates a second with two threads, that over one thread's, what two processes of one reach over one)."""
    command = [sys.executable, "-m", "tests.bench.bench_mpm", "child", "turns", name]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    runs: list[Any] = [
        subprocess.Popen([*command, str(n)], cwd=HOME, text=True, bufsize=1, **pipes)  # type: ignore[call-overload]
        for n in (1, 2, 1)
    ]
    one, both, other = runs

    def go(*which: Any) -> float:
        for run in which:
            run.stdin.write("\n")
        return max(float(run.stdout.readline()) for run in which)

    try:
        for run in runs:
            while run.stdout.readline().strip() != "ready":
                assert run.poll() is None
        seen = [(go(one), go(both), go(one, other)) for _ in range(TURNS)]
    finally:
        for run in runs:
            run.stdin.close()
            run.wait()
    alone, double, together = (statistics.median(column) for column in zip(*seen, strict=True))
    ratio = statistics.median(a / b for a, b, _ in seen)
    return COUNT * STEPS / double / 1e6, ratio, 2 * alone / together


def first(double: bool, folder: str) -> dict[str, float]:
    """Seconds of the processor's time that the first step of each material takes, with Taichi's cache in a folder."""
    start(double, offline_cache=True, offline_cache_file_path=folder, cpu_max_num_threads=1)
    begun, rows = time.process_time(), {}
    for name in MATERIALS:
        ours(name, 64, double).step(DT)
        rows[name] = time.process_time() - begun
        begun = time.process_time()
    return rows


@njit(fastmath={"contract"})
def _multiply(a: Any, keep: float, anew: float, times: int) -> None:
    for _ in range(times):
        for i in range(a.size):
            x = a[i]
            for _ in range(DEEP):
                x = x * keep + anew
            a[i] = x


@njit
def _copy(a: Any, b: Any) -> None:
    for i in range(a.size):
        b[i] = a[i]


def roofs() -> tuple[float, float]:
    """(10⁹ multiplications and additions, 10⁹ bytes) per second that one core of this machine reaches."""
    small, times = np.ones(2048, np.float32), 5_000
    big, other = np.ones(2**25, np.float32), np.empty(2**25, np.float32)
    best = [0.0, 0.0]
    for _ in range(6):
        begun = time.process_time()
        _multiply(small, np.float32(0.999), np.float32(1e-3), times)
        best[0] = max(best[0], 2 * DEEP * small.size * times / (time.process_time() - begun) / 1e9)
        begun = time.process_time()
        _copy(big, other)
        best[1] = max(best[1], 2 * big.nbytes / (time.process_time() - begun) / 1e9)
    return best[0], best[1]


def machine() -> str:
    """Its cores, by the name that Linux has for them."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    names = {line.partition(":")[2].strip() for line in lines if line.startswith("model name")}
    return f"{os.cpu_count()} cores, {', '.join(sorted(names)) or platform.machine()}"


def asked(*words: Any) -> Any:
    """What a fresh process says."""
    text = subprocess.run(
        [sys.executable, "-m", "tests.bench.bench_mpm", "child", *map(str, words)],
        cwd=HOME, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    return json.loads(text.splitlines()[-1])


def table() -> list[str]:
    """The lines of docs/mpm.md."""
    lines = ["| material | grid | precision | MPUPS | textbook | ratio |", "|---|---|---|---|---|---|"]
    for cells, double in ((64, 0), (64, 1), (128, 0)):
        for name, (mine, plain, ratio) in asked("rate", double, cells).items():
            precision = "double" if double else "single"
            lines.append(f"| {name} | {cells}³ | {precision} | {mine:.2f} | {plain:.2f} | {ratio:.1f} |")
            print(lines[-1], flush=True)
    lines += ["", "| material | two threads, MPUPS | over one | two processes over one |", "|---|---|---|---|"]
    for name in MATERIALS:
        mine, ratio, ceiling = two_threads(name)
        lines.append(f"| {name} | {mine:.2f} | {ratio:.2f} | {ceiling:.2f} |")
        print(lines[-1], flush=True)
    lines += ["", "| material | bytes a particle | cold start [s] | from the cache [s] |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        cold, warm = asked("first", folder), asked("first", folder)
    start(False)
    for name in MATERIALS:
        cloud = ours(name, 64, False)._clouds[0]
        size = 2 * cloud.records[0].nbytes + cloud.order.itemsize
        lines.append(f"| {name} | {size} | {cold[name]:.1f} | {warm[name]:.1f} |")
    arithmetic, memory = roofs()
    width = ours("Elastic", 64, False)._clouds[0].records[0].nbytes
    rate = asked("rate", 0, 64)["Elastic"][0]
    lines += ["", (
        f"Measured on {machine()}. One core reaches {arithmetic:.0f} GFLOP/s and {memory:.1f} GB/s. An elastic update "
        f"is {FLOPS} operations and moves {4 * width} bytes: {arithmetic * 1e3 / FLOPS:.0f} or "
        f"{memory * 1e3 / (4 * width):.0f} MPUPS at most; {rate:.2f} are "
        f"{100 * rate * FLOPS / arithmetic / 1e3:.0f} % and {100 * rate * 4 * width / memory / 1e3:.0f} %."
    )]  # fmt: skip
    return lines


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["child"]:
        kind, *rest = sys.argv[2:]
        if kind == "turns":
            turns(rest[0], int(rest[1]))
        else:
            print(json.dumps(first(False, rest[0]) if kind == "first" else child(rest[0] == "1", int(rest[1]))))
        return
    text = "\n".join([
        "# Speed of the continuum solver", "", (__doc__ or "").strip(), "", *table(), "",
        "## Its own viscosity", "", (bench_viscosity.__doc__ or "").strip(), "", *bench_viscosity.table(), "",
    ])  # fmt: skip
    print(text)
    if sys.argv[1:]:
        Path(sys.argv[1]).write_text(text)


if __name__ == "__main__":
    main()
