"""The continua (special materials and liquids) beside MuJoCo, on Taichi."""
