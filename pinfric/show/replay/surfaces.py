"""Surfaces that a replay draws with: rings, arcs, rods, cones, and how meshcat takes them."""

from __future__ import annotations

import itertools

import numpy as np

#: Pieces along a ring or an arc, and round its thickness.
SEGMENTS, SIDES = 96, 8
#: Vertices round a rod, a cone, a ball.
_ROUND = 32


def ring(radius: float, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a ring about z."""
    return tube(radius, thickness, 2.0 * np.pi)


def rings(radius: float, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Return three rings, about x, y and z: the marker of a ball joint."""
    vertices, faces = ring(radius, thickness)
    n = len(vertices)
    return (
        np.concatenate([np.roll(vertices, k, axis=1) for k in range(3)]),
        np.concatenate([faces + k * n for k in range(3)]),
    )


def tube(radius: float, thickness: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a tube along an arc about z from the x axis; its faces lie in order along the arc.

    A viewer that draws the first part of the faces draws the first part of the arc; negative
    angles turn the other way.
    """
    along = np.linspace(0.0, angle, SEGMENTS + 1)[:, None]
    across = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[None, :]
    reach = radius + thickness * np.cos(across)
    vertices = np.stack(
        (
            reach * np.cos(along),
            reach * np.sin(along),
            np.broadcast_to(thickness * np.sin(across), (SEGMENTS + 1, SIDES)),
        ),
        axis=-1,
    ).reshape(-1, 3)
    return vertices, _grid_faces(SEGMENTS, SIDES)


def cone(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a cone whose base lies in the plane z = 0 and whose tip is at z = height."""
    return _revolved([(0.0, 0.0), (radius, 0.0), (0.0, height)])


def rod(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a rod of length 1 from the origin along z."""
    return _revolved([(0.0, 0.0), (radius, 0.0), (radius, 1.0), (0.0, 1.0)])


def disc(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a disc in the plane z = 0."""
    return _revolved([(0.0, 0.0), (radius, 0.0)])


def wheel(radius: float, teeth: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Return a toothed wheel with a hole in the plane z = 0."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4 * teeth, endpoint=False)
    reach = np.tile([1.0, 1.0, 0.76, 0.76], teeth)
    around = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=1)
    vertices = np.concatenate((reach[:, None] * around, 0.36 * around))
    return radius * vertices, _grid_faces(1, 4 * teeth)


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a ball round the origin."""
    rows = _ROUND // 2
    down = np.linspace(0.0, np.pi, rows + 1)[:, None]
    round_ = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)[None, :]
    height = np.broadcast_to(np.cos(down), (rows + 1, _ROUND))
    points = (np.sin(down) * np.cos(round_), np.sin(down) * np.sin(round_), height)
    return radius * np.stack(points, axis=-1).reshape(-1, 3), _grid_faces(rows, _ROUND)


def box(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a box round the origin; its edges stay sharp."""
    square = np.array([(-0.5, -0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, 0.5), (-0.5, 0.5, 0.5)])
    vertices = [sign * np.roll(square, k, axis=1) for k in range(3) for sign in (1.0, -1.0)]
    faces = []
    for n in range(6):  # the mirrored square turns the other way: keep its outside out
        pair = np.array([(0, 1, 2), (0, 2, 3)])
        faces.append(4 * n + (pair if n % 2 == 0 else pair[:, ::-1]))
    return np.concatenate(vertices) * edges, np.concatenate(faces)


def _revolved(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Surface of revolution about z of a profile of (radius, height); edges stay sharp."""
    pairs = [pair for segment in itertools.pairwise(profile) for pair in segment]
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    rings = [
        np.stack((r * np.cos(angle), r * np.sin(angle), np.full(_ROUND, z)), axis=1)
        for r, z in pairs
    ]
    outside = _grid_faces(1, _ROUND)[:, ::-1]
    faces = [outside + 2 * _ROUND * k for k in range(len(profile) - 1)]
    return np.concatenate(rings), np.concatenate(faces)


def _grid_faces(rows: int, sides: int) -> np.ndarray:
    """Faces between `rows` + 1 rings of `sides` vertices each, row after row."""
    row, side = np.meshgrid(np.arange(rows), np.arange(sides), indexing="ij")
    a, b = row * sides + side, row * sides + (side + 1) % sides
    c, d = a + sides, b + sides
    return np.stack((np.stack((a, c, b), -1), np.stack((b, c, d), -1)), axis=2).reshape(-1, 3)
