"""MJCF templates: valid MJCF, each opens alone in the MuJoCo viewer; none sets a time step, gravity or a solver."""
