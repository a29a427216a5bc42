"""Is this machine ready? Every problem comes with the line that fixes it.

Needs nothing but the standard library, so that it can still speak when a dependency cannot: the graphics
driver, which may crash the process that asks it, is questioned in a process of its own (`probe`).
"""

import ctypes
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DISTRIBUTION = "physinone-mj"
PACKAGES = ("phenomena", "render", "mpm_sidecar", "mjcf_templates")

# Debian and Ubuntu packages behind the libraries below; taichi is what needs libX11.
GRAPHICS = ("libegl1", "libegl-mesa0", "libgl1", "libgl1-mesa-dri", "libopengl0", "libx11-6")
LIBRARIES = ("libEGL.so.1", "libOpenGL.so.0", "libGL.so.1", "libX11.so.6")
INSTALL_GRAPHICS = f"sudo apt-get install -y {' '.join(GRAPHICS)}"
RENDERER_VARIABLES = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID")

KNOWN_BUGS = {
    ("mujoco", "4.0.0"): (
        "the Newton solver can factor a sparse Hessian wrongly (mujoco issue 3767, fixed in 4.0.1)",
        "pip install 'mujoco>=4.0.1,<5'",
    ),
}

PROBE_SECONDS = 60.0
SCENE_GIB = 1.2  # a scene of 150 frames and 13 views, 1120 x 1120, stored without loss
EGL_EXTENSIONS, EGL_CUDA_DEVICE_NV = 0x3055, 0x323A  # EGL 1.5, EGL_NV_device_cuda


@dataclass(frozen=True)
class Finding:
    """One thing looked at: `ok` is False when scenes cannot be made; `fix` is a line to type.

    A `fix` with `ok` True is advice: it works, but not as well as it could.
    """

    name: str
    ok: bool
    value: str
    fix: str = ""


@dataclass(frozen=True)
class Driver:
    """What the graphics driver said: libraries not found, each EGL device's CUDA ordinal, who draws, or why nobody."""

    missing: Sequence[str] = ()
    devices: Sequence[int | None] = ()
    renderer: str = ""
    software: bool = False
    error: str = ""


def examine(output: Path = Path("out")) -> list[Finding]:
    """Look at everything a scene needs; `output` is the folder where scenes would be written."""
    return [
        python(),
        *dependencies(),
        *packages(),
        *environment(),
        *graphics(),
        disk(output),
        cores(),
    ]


def python() -> Finding:
    """The interpreter, 3.11 to 3.13: taichi has wheels for no later one."""
    good = (3, 11) <= sys.version_info < (3, 14)
    fix = "sudo apt-get install -y python3.11 python3.11-venv"
    return Finding("Python", good, platform.python_version(), "" if good else fix)


def dependencies() -> list[Finding]:
    """The declared dependencies against what is installed, by metadata alone: nothing is imported."""
    try:
        declared = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        return [Finding(DISTRIBUTION, False, "not installed, so its dependencies are unknown", "pip install -e .")]
    return [dependency(line) for line in sorted(declared) if "extra ==" not in line]


def dependency(requirement: str) -> Finding:
    """One line of requirements, such as `mujoco<5,>=4.0`; only the clauses `>=` and `<` are understood."""
    match = re.match(r"[\w.-]+", requirement)
    if match is None:
        raise ValueError(f"not a requirement: {requirement!r}")
    name, fix = match.group(), f"pip install '{requirement}'"
    try:
        version = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return Finding(name, False, "missing", fix)
    for sign, bound in re.findall(r"(>=|<)\s*([\d.]+)", requirement):
        if (release(version) >= release(bound)) != (sign == ">="):
            return Finding(name, False, f"{version}, needs {sign}{bound}", fix)
    if (name, version) in KNOWN_BUGS:
        bug, cure = KNOWN_BUGS[name, version]
        return Finding(name, True, f"{version}: {bug}", cure)
    return Finding(name, True, version)


def release(version: str) -> tuple[int, ...]:
    """The numbers of a version, without trailing zeros: `4.10.0rc1` is (4, 10)."""
    match = re.match(r"\d+(\.\d+)*", version)
    if match is None:
        raise ValueError(f"not a version: {version!r}")
    numbers = [int(number) for number in match.group().split(".")]
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def packages() -> list[Finding]:
    """Whether our top-level packages are ours: other distributions may use the same plain names."""
    owners = importlib.metadata.packages_distributions()
    return [package(name, [owner for owner in owners.get(name, []) if owner != DISTRIBUTION]) for name in PACKAGES]


def package(name: str, others: list[str]) -> Finding:
    """One top-level package, which must lie beside `physinone_mj` and belong to no distribution in `others`."""
    ours = Path(__file__).resolve().parents[1] / name
    spec = importlib.util.find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        return Finding(f"package {name}", False, "not found", "pip install -e .")
    found = Path(next(iter(spec.submodule_search_locations))).resolve()
    if others:
        value = f"{found} clashes with the distribution {', '.join(others)}"
        return Finding(f"package {name}", False, value, f"pip uninstall -y {' '.join(others)}")
    if found == ours:
        return Finding(f"package {name}", True, str(found))
    search = [Path(entry or ".").resolve() for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    in_pythonpath = "PYTHONPATH" in os.environ and found.parent in search
    fix = "unset PYTHONPATH" if in_pythonpath else f"mv {found} {found}_other"
    return Finding(f"package {name}", False, f"{found} hides {ours}", fix)


def environment() -> list[Finding]:
    """Variables which make the renderer fail, or `import mujoco` itself."""
    findings = []
    for variable in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):
        value = os.environ.get(variable, "")
        if value.lower() not in ("", "egl"):
            findings.append(Finding(variable, False, f"{value}: pictures come through egl only", f"unset {variable}"))
    variable = "__EGL_VENDOR_LIBRARY_FILENAMES"
    for vendor in filter(None, os.environ.get(variable, "").split(os.pathsep)):
        if not Path(vendor).is_file():
            findings.append(Finding(variable, False, f"no such file: {vendor}", f"unset {variable}"))
    return findings or [Finding("environment", True, "no variable in the way")]


def graphics() -> list[Finding]:
    """The GL libraries, a context and who draws in it, and which EGL device is which GPU."""
    driver, gpus = ask_driver(), nvidia_gpus()
    return [libraries(driver), context(driver, gpus), gpu(driver, gpus), *device_choice(driver)]


def missing_packages() -> list[str]:
    """The Debian packages that rendering lacks; none where it works, or fails for a reason no package mends."""
    if all(finding.ok for finding in graphics()):
        return []
    query = ["dpkg-query", "--show", "--showformat=${Package} ${db:Status-Status}\n", *GRAPHICS]
    try:
        known = subprocess.run(query, capture_output=True, text=True, check=False).stdout.splitlines()
    except FileNotFoundError:
        known = []
    return [name for name in GRAPHICS if f"{name} installed" not in known]


def libraries(driver: Driver) -> Finding:
    """The shared libraries that rendering and taichi load."""
    if driver.missing:
        return Finding("GL libraries", False, f"missing: {', '.join(driver.missing)}", INSTALL_GRAPHICS)
    return Finding("GL libraries", True, ", ".join(LIBRARIES))


def context(driver: Driver, gpus: list[str]) -> Finding:
    """GL_RENDERER of a context that was made current, and whether it is software, or why there is none."""
    if driver.error:
        suspects = (*environment(), *device_choice(driver))
        unset = [finding.fix for finding in suspects if finding.name in RENDERER_VARIABLES]
        return Finding("OpenGL context", False, driver.error, unset[0] if unset else INSTALL_GRAPHICS)
    if driver.software:
        value = f"{driver.renderer}: software, on the CPU"
        return Finding("OpenGL context", True, value, gpu_fix(gpus) if gpus else "")
    return Finding("OpenGL context", True, driver.renderer)


def gpu(driver: Driver, gpus: list[str]) -> Finding:
    """The NVIDIA GPUs, and the EGL device that draws on each."""
    pairs = [f"CUDA {cuda} is EGL device {egl}" for egl, cuda in enumerate(driver.devices) if cuda is not None]
    if gpus and not pairs:
        return Finding("GPU", True, f"{'; '.join(gpus)}; no EGL device draws on it", gpu_fix(gpus))
    return Finding("GPU", True, "; ".join(gpus + pairs) or "none: pictures are drawn on the CPU")


def device_choice(driver: Driver) -> list[Finding]:
    """A MUJOCO_EGL_DEVICE_ID that names no device."""
    variable = "MUJOCO_EGL_DEVICE_ID"
    chosen = os.environ.get(variable, "")
    known = {str(number) for number in (*range(len(driver.devices)), *driver.devices)}
    if not chosen or not driver.devices or chosen in known:
        return []
    value = f"{chosen}: there are {len(driver.devices)} EGL devices, counted from 0"
    return [Finding(variable, False, value, f"unset {variable}")]


def gpu_fix(gpus: list[str]) -> str:
    """How to let an NVIDIA GPU draw as well as compute: a package, or in a container a capability."""
    if "NVIDIA_VISIBLE_DEVICES" in os.environ:
        return "docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=all ..."
    branch = re.search(r"driver (\d+)", gpus[0])
    try:
        ubuntu = platform.freedesktop_os_release()["ID"] == "ubuntu"
    except OSError:
        ubuntu = False
    return f"sudo apt-get install -y {f'libnvidia-gl-{branch.group(1)}' if ubuntu and branch else 'libegl-nvidia0'}"


def nvidia_gpus() -> list[str]:
    """One line per GPU that nvidia-smi lists (name, driver, memory); none without nvidia-smi."""
    if shutil.which("nvidia-smi") is None:
        return []
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    try:
        listed = subprocess.run(query, capture_output=True, text=True, timeout=PROBE_SECONDS, check=True).stdout
    except (subprocess.SubprocessError, OSError):
        return []
    rows = [row.split(", ") for row in listed.splitlines() if row.count(", ") == 2]
    return [f"{name} (driver {version}, {memory})" for name, version, memory in rows]


def ask_driver() -> Driver:
    """Run `probe` in a process of its own and read what it could say before it ended, hung or crashed."""
    command = [sys.executable, "-c", "from physinone_mj.doctor import probe; probe()"]
    home = Path(__file__).resolve().parents[1]  # first on the child's path: our `render`, whoever hides it here
    with subprocess.Popen(command, cwd=home, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        try:
            said, complaint = child.communicate(timeout=PROBE_SECONDS)
        except subprocess.TimeoutExpired:
            child.kill()
            said, complaint = child.communicate()[0], f"the graphics driver was silent for {PROBE_SECONDS:.0f} s"
        else:
            if child.returncode < 0:
                complaint = f"the graphics driver crashed with {signal.Signals(-child.returncode).name}"
    facts: dict[str, Any] = {}
    for line in said.splitlines():
        if line.startswith("{"):
            facts |= json.loads(line)
    if not facts.keys() & {"renderer", "error"}:
        facts["error"] = (complaint.strip().splitlines() or ["the graphics driver gave no reason"])[-1]
    return Driver(**facts)


def probe() -> None:
    """Print what the graphics driver offers, one JSON object per line; may crash with the driver."""

    def say(**facts: object) -> None:
        print(json.dumps(facts), flush=True)

    missing = []
    for name in LIBRARIES:
        try:
            ctypes.CDLL(name)
        except OSError:
            missing.append(name)
    say(missing=missing)
    if "libEGL.so.1" not in missing:
        say(devices=egl_devices())

    from render.egl import NoGL, gl_info

    try:
        drawn_by = gl_info()
    except NoGL as failure:
        say(error=str(failure).partition("; on Debian")[0])  # the finding has a fix of its own
    else:
        say(renderer=drawn_by["renderer"], software=drawn_by["software"])


def egl_devices() -> list[int | None]:
    """The CUDA ordinal behind each EGL device, None for one without; empty if the driver cannot list them."""
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    number, pointer = ctypes.c_int, ctypes.c_void_p

    def function(name: str, result: Any, *arguments: Any) -> Any:
        address = egl.eglGetProcAddress(name.encode())
        return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None

    list_devices = function("eglQueryDevicesEXT", number, number, pointer, pointer)
    describe = function("eglQueryDeviceStringEXT", ctypes.c_char_p, pointer, number)
    attribute = function("eglQueryDeviceAttribEXT", number, pointer, number, pointer)
    if not (list_devices and describe and attribute):
        return []
    found, count = (ctypes.c_void_p * 64)(), ctypes.c_int()
    if not list_devices(64, found, ctypes.byref(count)):
        return []
    ordinals: list[int | None] = []
    for device in found[: count.value]:
        ordinal = ctypes.c_ssize_t()
        on_cuda = b"EGL_NV_device_cuda" in (describe(device, EGL_EXTENSIONS) or b"")
        known = on_cuda and attribute(device, EGL_CUDA_DEVICE_NV, ctypes.byref(ordinal))
        ordinals.append(ordinal.value if known else None)
    return ordinals


def disk(output: Path) -> Finding:
    """Free space [GiB] and write permission where scenes would go; the folder itself need not exist yet."""
    folder = output.resolve()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free / 2**30
    value = f"{free:.1f} GiB free at {folder}"
    elsewhere = "physinone run 46 -o /path/on/another/disk"
    if not os.access(folder, os.W_OK):
        return Finding("disk", False, f"{folder} is not writable", elsewhere)
    return Finding("disk", free >= SCENE_GIB, value, "" if free >= SCENE_GIB else elsewhere)


def cores() -> Finding:
    """The CPU cores this process may use."""
    return Finding("CPU cores", True, f"{len(os.sched_getaffinity(0))} of {os.cpu_count()}")
