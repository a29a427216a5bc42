"""Numbers read off a run: crossings, periods, peaks, fits, velocities around an impact, thresholds.

Samples carry positions and velocities; between them the two define a polynomial of seventh degree through four
neighbours (Hermite), so that a crossing is found to the accuracy of the run, not of the sampling.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import KroghInterpolator
from scipy.optimize import brentq

from .base import NotEvaluated
from .run import Run

Array = NDArray[np.float64]

IMPACT_WINDOW: Final = 0.02
"""Seconds on each side of an impact over which velocities are fitted (catalogue, measurement protocol 2)."""


def _interpolant(t: Array, x: Array, v: Array, i: int) -> KroghInterpolator:
    """Polynomial through samples i-1 ... i+2, positions and velocities, in time since t[i]."""
    first = min(max(i - 1, 0), max(len(t) - 4, 0))
    part = slice(first, first + 4)
    nodes = np.repeat(t[part] - t[i], 2)
    return KroghInterpolator(nodes, np.column_stack([x[part], v[part]]).ravel())


def _root(f: Callable[[float], Any], stop: float) -> float:
    """Where f changes its sign between 0 and `stop`; an end, if it vanishes there and rounding hides the change."""
    first, last = float(f(0.0)), float(f(stop))
    if first * last >= 0:
        return 0.0 if abs(first) <= abs(last) else stop
    return float(brentq(f, 0.0, stop, xtol=1e-15, rtol=1e-14))


def crossings(t: Array, x: Array, v: Array, level: float = 0.0, *, rising: bool = True) -> Array:
    """Times (n,) at which x passes the level upwards (or downwards)."""
    y = (x - level) if rising else (level - x)
    w = v if rising else -v
    found = []
    for i in np.nonzero((y[:-1] < 0) & (y[1:] >= 0))[0]:
        f = _interpolant(t, y, w, int(i))
        found.append(t[i] + _root(f, t[i + 1] - t[i]))
    return np.array(found)


def period(t: Array, x: Array, v: Array, *, least: int = 3) -> float:
    """Mean time between upward zero crossings [s]; NotEvaluated with fewer than `least` whole periods."""
    times = crossings(t, x, v)
    if len(times) < least + 1:
        raise NotEvaluated(f"{max(len(times) - 1, 0)} whole periods recorded; needed: {least}")
    return float((times[-1] - times[0]) / (len(times) - 1))


def peaks(t: Array, x: Array, v: Array) -> tuple[Array, Array]:
    """Times (n,) and heights (n,) of the local maxima of x."""
    times, heights = [], []
    for i in np.nonzero((v[:-1] > 0) & (v[1:] <= 0))[0]:
        f = _interpolant(t, x, v, int(i))
        s = _root(f.derivative, t[i + 1] - t[i])
        times.append(t[i] + s)
        heights.append(float(f(s)))
    return np.array(times), np.array(heights)


def value(t: Array, x: Array, v: Array, when: float) -> float:
    """x at any time within the record; v is its derivative."""
    i = int(np.clip(np.searchsorted(t, when) - 1, 0, len(t) - 2))
    return float(_interpolant(t, x, v, i)(when - t[i]))


def between(t: Array, start: float, stop: float, *, least: int = 5) -> NDArray[np.bool_]:
    """Mask (T,) of the samples strictly inside a window; NotEvaluated if there are fewer than `least`."""
    mask = (t > start) & (t < stop)
    if mask.sum() < least:
        raise NotEvaluated(f"{mask.sum()} samples between {start:.4g} s and {stop:.4g} s; needed: {least}")
    return np.asarray(mask)


def fit(t: Array, x: Array, degree: int) -> Array:
    """Least-squares polynomial coefficients, lowest first, in time since t[0]: (degree + 1,) or (degree + 1, n)."""
    s = t - t[0]
    scale = s[-1]
    coefficients = np.linalg.lstsq(np.vander(s / scale, degree + 1, increasing=True), x, rcond=None)[0]
    powers = scale ** np.arange(degree + 1)
    return np.asarray(coefficients / (powers if x.ndim == 1 else powers[:, None]))


def acceleration(t: Array, x: Array) -> float:
    """Constant acceleration of a stretch of record, by least squares on positions [unit of x / s²]."""
    return float(2 * fit(t, x, 2)[2])


def accelerations(t: Array, x: Array, v: Array) -> Array:
    """Second derivatives (T - 4,) of uniform samples at all but the two first and last, to the eighth order.

    From the positions and velocities of five neighbours; v is the derivative of x.
    """
    h = t[1] - t[0]
    sums, slopes = x[3:-1] + x[1:-3], v[3:-1] - v[1:-3]
    wide_sums, wide_slopes = x[4:] + x[:-4], v[4:] - v[:-4]
    curved = -5 * x[2:-2] + 64 / 27 * sums + 7 / 54 * wide_sums
    return np.asarray(curved / h**2 - (8 / 9 * slopes + wide_slopes / 36) / h)


def around(run: Run, body: str, when: float, *, spin: bool = False) -> tuple[Array, Array]:
    """A body's velocity (3,) just before and just after an impact, extrapolated to it by straight-line fits over 20 ms.

    The windows end early at the next impact of any kind. `spin`: angular velocity instead. NotEvaluated if a window
    holds fewer than three samples.
    """
    data = run.spin(body) if spin else run.velocity(body)
    others = [i.time for i in run.impacts if abs(i.time - when) > 1e-9]
    start = max([when - IMPACT_WINDOW, *(o for o in others if o < when)])
    stop = min([when + IMPACT_WINDOW, *(o for o in others if o > when)])
    sides = []
    for low, high in ((start, when), (when, stop)):
        mask = between(run.t, low, high, least=3)
        line = fit(run.t[mask], data[mask], 1)
        sides.append(line[0] + line[1] * (when - run.t[mask][0]))
    return sides[0], sides[1]


def threshold(goes: Callable[[float], bool], guess: float, *, spread: float, resolution: float) -> float:
    """The value at which `goes` turns from False to True, by bisection between guess·(1 ∓ spread).

    resolution: relative width at which to stop. Returned is the end of the last bracket that lies farther from the
    guess: what is known is that the threshold is no farther. NaN (which fails any law) if the first bracket does not
    hold at its lower end or does not go at its upper end.
    """
    low, high = guess * (1 - spread), guess * (1 + spread)
    if goes(low) or not goes(high):
        return float("nan")
    while high - low > resolution * guess:
        middle = (low + high) / 2
        low, high = (low, middle) if goes(middle) else (middle, high)
    return max(low, high, key=lambda end: abs(end - guess))
