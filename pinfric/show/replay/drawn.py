"""Triangles and tracks of time for meshcat's viewer, packed small."""

from __future__ import annotations

from typing import Any

import meshcat.geometry as mg
import numpy as np
import umsgpack  # type: ignore[import-untyped]

#: Codes of msgpack's extension types for JavaScript's arrays.
_CODES = {
    "Int8": 0x11,
    "Uint8": 0x12,
    "Int16": 0x13,
    "Uint16": 0x14,
    "Uint32": 0x16,
    "Float32": 0x17,
}


class Surface(mg.Mesh):
    """A trimesh in its own colours or in one, lit or flat, optionally on top of everything.

    Args:
        mesh: `trimesh.Trimesh`.
        color: "#rrggbb"; None takes the colours of its vertices.
        opacity: 1 is opaque.
        on_top: drawn over everything else, also what is in front of it.
    """

    def __init__(
        self, mesh: Any, color: str | None = None, opacity: float = 1.0, on_top: bool = False
    ) -> None:
        kind = mg.MeshBasicMaterial if on_top else mg.MeshPhongMaterial
        # ObjectLoader takes these keys of three.js as they are
        extra = {"depthTest": False, "depthWrite": False} if on_top else {"shininess": 40}
        if color is None:
            opacity, extra["vertexColors"] = mesh.visual.vertex_colors[0, 3] / 255, True
        material = kind(color=int((color or "#ffffff")[1:], 16), opacity=float(opacity), **extra)
        if on_top:
            material.transparent = True  # opaque objects are drawn first, whatever their order
        super().__init__(_Packed(mesh, color is None), material)
        self.on_top = on_top

    def lower(self) -> dict[str, Any]:
        """Return three.js's form of the object."""
        data: dict[str, Any] = super().lower()
        data["object"]["renderOrder"] = 10 if self.on_top else 0
        return data


class _Packed(mg.Geometry):
    """Positions as 16-bit integers between the least and the greatest."""

    def __init__(self, mesh: Any, colored: bool) -> None:
        super().__init__()
        self.mesh, self.colored = mesh, colored
        low, high = mesh.bounds
        self.middle, self.half = 0.5 * (low + high), max(0.5 * float((high - low).max()), 1e-9)

    def intrinsic_transform(self) -> np.ndarray:
        """Return the matrix from the integers to m, by columns."""
        matrix = np.diag([self.half, self.half, self.half, 1.0])
        matrix[3, :3] = self.middle
        return matrix

    def lower(self, _data: dict[str, Any]) -> dict[str, Any]:
        mesh = self.mesh
        position = np.round(32767.0 * (mesh.vertices - self.middle) / self.half)
        attributes = {
            "position": _attribute(position, "Int16", 3, True),
            "normal": _attribute(np.round(127.0 * mesh.vertex_normals), "Int8", 3, True),
        }
        if self.colored:
            colors = mesh.visual.vertex_colors[:, :3]
            attributes["color"] = _attribute(colors, "Uint8", 3, True)
        index = "Uint16" if len(position) < 2**16 else "Uint32"
        data = {"attributes": attributes, "index": _attribute(mesh.faces, index, 1)}
        return {"uuid": self.uuid, "type": "BufferGeometry", "data": data}


class Track:
    """A property over time: meshcat's `AnimationTrack`, but of arrays in place of keys.

    Args:
        name: of a property of three.js's object.
        kind: of the values: "vector3", "quaternion" or "boolean".
        times: (F,) s, from 0 on.
        values: (F, n), or F booleans.
    """

    def __init__(self, name: str, kind: str, times: Any, values: Any) -> None:
        self.name, self.kind, self.times, self.values = name, kind, times, values

    def lower(self) -> dict[str, Any]:
        """Return three.js's form of the track."""
        boolean = self.kind == "boolean"
        values = list(map(bool, self.values)) if boolean else _packed(self.values, "Float32")
        times = _packed(self.times, "Float32")
        return {"name": f".{self.name}", "type": self.kind, "times": times, "values": values}


def _attribute(array: np.ndarray, kind: str, size: int, normalized: bool = False) -> dict[str, Any]:
    return {
        "itemSize": size,
        "type": f"{kind}Array",
        "array": _packed(array, kind),
        "normalized": normalized,
    }


def _packed(array: np.ndarray, kind: str) -> Any:
    values = np.ascontiguousarray(array, dtype=np.dtype(kind.lower()).newbyteorder("<"))
    return umsgpack.Ext(_CODES[kind], values.tobytes())
