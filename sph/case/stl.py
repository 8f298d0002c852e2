"""Closed surfaces from STL files, read by trimesh (extra `stl`)."""

import functools
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.errors import ConfigError
from hpcpic.core.files.given import content_of

if TYPE_CHECKING:
    from sph.case.shapes import Stl


@functools.lru_cache(maxsize=16)
def mesh(stl: "Stl") -> Any:
    """The trimesh of a closed surface, scaled and moved. Raises ConfigError when it cannot be one."""
    try:
        import trimesh
    except ImportError as error:
        raise ConfigError(f"{stl.file}: STL files need more packages: pip install 'hpcpic[stl]'") from error
    try:
        content = content_of(stl.file)
        found: Any = trimesh.load(io.BytesIO(content), file_type="stl", force="mesh")
    except Exception as error:  # whatever a parser says of files that are none
        words = error.strerror if isinstance(error, OSError) else str(error) or type(error).__name__
        raise ConfigError(f"{stl.file}: cannot be read as STL ({words})") from error
    if not len(found.faces):
        raise ConfigError(f"{stl.file}: holds no triangles")
    if not np.isfinite(found.vertices).all():
        raise ConfigError(f"{stl.file}: has corners that are not finite")
    if not found.is_watertight:
        raise ConfigError(f"{stl.file}: the surface is not closed, so it has no inside")
    if not found.is_winding_consistent:
        raise ConfigError(f"{stl.file}: triangles look different ways: turn the normals of all of them outward")
    found.apply_scale(stl.scale)
    if stl.shift:
        found.apply_translation(stl.shift)
    if found.volume < 0:
        found.invert()
    return found
