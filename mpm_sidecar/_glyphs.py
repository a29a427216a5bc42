"""Letters drawn with one round stroke: the lines of their middles, A to Z and 0 to 9. Of our own design.

A glyph is a list of open polygons, each (n, 2); its capital's lines run from 0 to 1 upwards and begin at x = 0. The
stroke is `STROKE` wide about them: the letter is 1 + STROKE high and nowhere thinner than STROKE.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STROKE: Final = 0.22
GAP: Final = 0.22
"""Between the outlines of neighbours."""
SPACE: Final = 0.5
"""Width of a blank."""


def _arc(x: float, y: float, wide: float, high: float, start: float, stop: float) -> list[tuple[float, float]]:
    """Of an ellipse about (x, y) between two angles [degrees]; a corner at each 7.5 degrees or less, and at its
    uppermost, lowest, leftmost and rightmost points, so that the letter is as high as it should be."""
    even = np.linspace(start, stop, 1 + int(np.ceil(abs(stop - start) / 7.5)))
    ends = np.arange(-360.0, 361.0, 90.0)
    turn = np.unique(np.append(even, ends[(ends > min(start, stop)) & (ends < max(start, stop))]))
    turn = np.radians(turn if start < stop else turn[::-1])
    return [(float(x + wide * np.cos(a)), float(y + high * np.sin(a))) for a in turn]


_P = [(0.0, 1.0), *_arc(0.35, 0.735, 0.265, 0.265, 90, -90), (0.0, 0.47)]
_SIX = [_arc(0.3, 0.31, 0.3, 0.31, 0, 360), _arc(0.47, 0.31, 0.47, 0.69, 180, 88)]
_LINES: Final[dict[str, list[list[tuple[float, float]]]]] = {
    "A": [[(0, 0), (0.4, 1), (0.8, 0)], [(0.128, 0.32), (0.672, 0.32)]],
    "B": [
        [(0, 0), (0, 1), *_arc(0.34, 0.765, 0.235, 0.235, 90, -90), (0, 0.53)],
        [(0, 0.53), *_arc(0.36, 0.265, 0.265, 0.265, 90, -90), (0, 0)],
    ],
    "C": [_arc(0.42, 0.5, 0.42, 0.5, 45, 315)],
    "D": [[(0, 0), (0, 1), *_arc(0.25, 0.5, 0.42, 0.5, 90, -90), (0, 0)]],
    "E": [[(0.55, 1), (0, 1), (0, 0), (0.55, 0)], [(0, 0.5), (0.47, 0.5)]],
    "F": [[(0.55, 1), (0, 1), (0, 0)], [(0, 0.5), (0.47, 0.5)]],
    "G": [[*_arc(0.42, 0.5, 0.42, 0.5, 45, 355), (0.5, 0.456)]],
    "H": [[(0, 0), (0, 1)], [(0.64, 0), (0.64, 1)], [(0, 0.5), (0.64, 0.5)]],
    "I": [[(0, 0), (0, 1)]],
    "J": [[(0.46, 1), *_arc(0.23, 0.25, 0.23, 0.25, 0, -180)]],
    "K": [[(0, 0), (0, 1)], [(0.6, 1), (0, 0.36)], [(0.22, 0.595), (0.64, 0)]],
    "L": [[(0, 1), (0, 0), (0.52, 0)]],
    "M": [[(0, 0), (0, 1), (0.43, 0.25), (0.86, 1), (0.86, 0)]],
    "N": [[(0, 0), (0, 1), (0.66, 0), (0.66, 1)]],
    "O": [_arc(0.42, 0.5, 0.42, 0.5, 0, 360)],
    "P": [[(0, 0), *_P]],
    "Q": [_arc(0.42, 0.5, 0.42, 0.5, 0, 360), [(0.52, 0.3), (0.84, 0)]],
    "R": [[(0, 0), *_P], [(0.3, 0.47), (0.62, 0)]],
    "S": [[*_arc(0.3, 0.75, 0.3, 0.25, 30, 270), *_arc(0.3, 0.25, 0.3, 0.25, 90, -150)]],
    "T": [[(0, 1), (0.72, 1)], [(0.36, 1), (0.36, 0)]],
    "U": [[(0, 1), *_arc(0.32, 0.32, 0.32, 0.32, 180, 360), (0.64, 1)]],
    "V": [[(0, 1), (0.39, 0), (0.78, 1)]],
    "W": [[(0, 1), (0.28, 0), (0.56, 0.85), (0.84, 0), (1.12, 1)]],
    "X": [[(0, 0), (0.66, 1)], [(0, 1), (0.66, 0)]],
    "Y": [[(0, 1), (0.36, 0.45), (0.72, 1)], [(0.36, 0.45), (0.36, 0)]],
    "Z": [[(0, 1), (0.6, 1), (0, 0), (0.6, 0)]],
    "0": [_arc(0.32, 0.5, 0.32, 0.5, 0, 360)],
    "1": [[(0, 0.76), (0.28, 1), (0.28, 0)]],
    "2": [[*_arc(0.29, 0.71, 0.29, 0.29, 165, -42), (0, 0), (0.6, 0)]],
    "3": [[*_arc(0.27, 0.765, 0.26, 0.235, 150, -90), *_arc(0.27, 0.265, 0.3, 0.265, 90, -150)]],
    "4": [[(0.5, 0), (0.5, 1), (0, 0.28), (0.68, 0.28)]],
    "5": [[(0.54, 1), (0.06, 1), *_arc(0.27, 0.31, 0.32, 0.31, 132, -145)]],
    "6": _SIX,
    "7": [[(0, 1), (0.6, 1), (0.2, 0)]],
    "8": [_arc(0.3, 0.765, 0.25, 0.235, 0, 360), _arc(0.3, 0.265, 0.3, 0.265, 0, 360)],
    "9": [[(0.6 - x, 1 - y) for x, y in line] for line in _SIX],
}
ALPHABET: Final = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"


def glyph(letter: str) -> list[Array]:
    """The lines of a letter of the alphabet, no two neighbouring points alike, the leftmost at x = 0."""
    lines = [np.array(line, float) for line in _LINES[letter]]
    lines = [line[np.append(True, np.abs(np.diff(line, axis=0)).max(axis=1) > 1e-9)] for line in lines]
    left = min(line[:, 0].min() for line in lines)
    return [line - np.array([left, 0.0]) for line in lines]
