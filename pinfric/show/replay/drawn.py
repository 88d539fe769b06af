"""Surfaces and meshes in the form that meshcat's viewer takes."""

from __future__ import annotations

from typing import Any

import meshcat.geometry as mg
import numpy as np

from pinfric.show.replay.meshes import Mesh

#: Codes of msgpack's extension types for JavaScript's arrays.
_INT8, _UINT8, _UINT16, _UINT32, _FLOAT32 = 0x11, 0x12, 0x14, 0x16, 0x17
#: Bits of a coordinate's mantissa that are kept: 1 in 60 000, and the page shrinks by a quarter.
_KEPT = np.uint32(0xFFFFFF00)


class Surface(mg.Mesh):
    """A triangulated surface in one colour, lit or flat, optionally on top of everything.

    Args:
        vertices, faces: (n, 3) in m and (k, 3) indices.
        color: "#rrggbb".
        opacity: 1 is opaque.
        on_top: drawn over everything else, also what is in front of it.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        color: str,
        opacity: float = 1.0,
        on_top: bool = False,
    ) -> None:
        kind = mg.MeshBasicMaterial if on_top else mg.MeshPhongMaterial
        # ObjectLoader takes these keys of three.js as they are
        extra = {"depthTest": False, "depthWrite": False} if on_top else {"shininess": 60}
        material = kind(color=int(color[1:], 16), opacity=opacity, **extra)
        if on_top:
            material.transparent = True  # opaque objects are drawn first, whatever their order
        super().__init__(mg.TriangularMeshGeometry(vertices, faces), material)
        self.on_top = on_top

    def lower(self) -> dict[str, Any]:
        """Return three.js's form of the object."""
        data: dict[str, Any] = super().lower()
        data["object"]["renderOrder"] = 10 if self.on_top else 0
        return data


class DrawnMesh(mg.Mesh):
    """A mesh with a colour per vertex, packed small: normals and colours take a byte a number."""

    def __init__(self, mesh: Mesh) -> None:
        material = mg.MeshPhongMaterial(
            color=0xFFFFFF, vertexColors=True, shininess=35, opacity=mesh.opacity
        )
        super().__init__(_Packed(mesh), material)


class _Packed(mg.Geometry):
    def __init__(self, mesh: Mesh) -> None:
        super().__init__()
        self.mesh = mesh

    def lower(self, _data: dict[str, Any]) -> dict[str, Any]:
        mesh = self.mesh
        position = np.ascontiguousarray(mesh.vertices, dtype="<f4")
        position = (position.view(np.uint32) & _KEPT).view("<f4")
        small = len(position) < 2**16
        index = mesh.faces.astype("<u2" if small else "<u4")
        attributes = {
            "position": _array(position, "Float32Array", _FLOAT32),
            "color": _array(mesh.colors.astype(np.uint8), "Uint8Array", _UINT8, True),
        }
        if mesh.normals is not None:
            normals = np.round(127.0 * mesh.normals).astype(np.int8)
            attributes["normal"] = _array(normals, "Int8Array", _INT8, True)
        kind = ("Uint16Array", _UINT16) if small else ("Uint32Array", _UINT32)
        return {
            "uuid": self.uuid,
            "type": "BufferGeometry",
            "data": {"attributes": attributes, "index": _array(index, *kind)},
        }


def _array(array: np.ndarray, kind: str, code: int, normalized: bool = False) -> dict[str, Any]:
    import umsgpack  # type: ignore[import-untyped]

    return {
        "itemSize": 1 if kind.startswith("Uint") and code in (_UINT16, _UINT32) else 3,
        "type": kind,
        "array": umsgpack.Ext(code, np.ascontiguousarray(array).tobytes()),
        "normalized": normalized,
    }
