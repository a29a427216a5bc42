"""Physical constants: value, unit and source of each."""

from typing import Final

STANDARD_GRAVITY: Final = 9.80665
"""g [m/s²]; exact by definition (3rd CGPM, 1901; SI Brochure). MuJoCo's own default is 9.81."""

AIR_DENSITY: Final = 1.2250
"""ρ of dry air at 15 °C and 101 325 Pa [kg/m³] (ISO 2533, the International Standard Atmosphere, at sea level)."""
