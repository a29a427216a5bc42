"""Headless OpenGL contexts through EGL; the only module that opens the driver.

Importing this module loads no OpenGL: the driver is loaded when a :class:`Context` is made.
"""

from __future__ import annotations

import os
from types import TracebackType
from typing import Self

FIX = "sudo apt-get install -y libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri"
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software rasterizer")


class NoGL(RuntimeError):
    """No OpenGL can be had here; the message is one line that says what failed and what mends it."""

    def __init__(self, failure: str) -> None:
        super().__init__(f"no headless OpenGL: {' '.join(failure.split())[:300]}; on Debian or Ubuntu run: {FIX}")
        self.failure = failure

    def __reduce__(self) -> tuple[type[NoGL], tuple[str]]:
        return NoGL, (self.failure,)


class Context:
    """An OpenGL context without a window, current in the thread that made it until :meth:`close`.

    Raises:
        NoGL: libraries or a driver are missing, or the process already bound PyOpenGL to another platform.
    """

    def __init__(self) -> None:
        if os.environ.get("PYOPENGL_PLATFORM", "egl").lower() != "egl":
            raise NoGL(f"PYOPENGL_PLATFORM={os.environ['PYOPENGL_PLATFORM']!r} is set, unset it or set it to 'egl'")
        os.environ["MUJOCO_GL"] = os.environ["PYOPENGL_PLATFORM"] = "egl"
        try:
            from mujoco.egl import GLContext

            self._context = GLContext(1, 1)
            self._context.make_current()
        # PyOpenGL reports a missing library as AttributeError or TypeError, a missing driver as ImportError or GLError
        except Exception as failure:
            raise NoGL(f"{type(failure).__name__}: {failure}") from None

    def info(self) -> dict[str, str | bool]:
        """Vendor, renderer and version strings of the driver, and `software`: True where a CPU draws."""
        from OpenGL import GL

        self._context.make_current()
        names = {"vendor": GL.GL_VENDOR, "renderer": GL.GL_RENDERER, "version": GL.GL_VERSION}
        strings = {name: str(GL.glGetString(key).decode()) for name, key in names.items()}
        software = any(mark in strings["renderer"].lower() for mark in SOFTWARE)
        return {**strings, "software": software}

    def make_current(self) -> None:
        """Bind the context to the calling thread."""
        self._context.make_current()

    def close(self) -> None:
        """Destroy the context; the object is of no use afterwards."""
        self._context.free()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def gl_info() -> dict[str, str | bool]:
    """What draws here: `vendor`, `renderer`, `version`, `software`; opens a context for the purpose.

    Raises:
        NoGL: there is no driver.
    """
    with Context() as context:
        return context.info()
