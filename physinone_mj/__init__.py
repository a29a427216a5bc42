"""physinone_mj: from the index of a phenomenon to a verified, rendered, annotated scene."""

__version__ = "0.1.0"
