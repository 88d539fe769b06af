"""The recursion of inverse dynamics for the wrenches of a tree's joints, eight samples at once.

Newton's and Euler's equations, link by link (Featherstone 2008, Rigid body dynamics algorithms,
table 5.1), with every joint opened as in `twin`: the state of a joint is its placement, its twist t
and the derivative of t, in the child's frame.

    outwards    v = X v_parent + t,     a = X a_parent + t' + v x t,    f = I a + v x* I v
    inwards     f_parent += X^T f
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinfric.kernels.compiled import kernel
from pinfric.kernels.lanes import LANES, on_lanes, where
from pinfric.model.twin import CONTINUOUS, PRISMATIC, Embedding, Twin, embed_many

#: Rows of a joint: its position; quaternion, then rotation; twist, then velocity; derivative of the
#: twist, then acceleration; wrench.
_P, _R, _V, _A, _F, _ROWS = 0, 3, 12, 18, 24, 30
#: Numbers of a joint: rotation and position in its parent; mass, center, and inertia about that.
_PLACED, _AT, _MASS, _CENTER, _INERTIA, _NUMBERS = 0, 9, 12, 13, 16, 22
#: Rows of what a joint of one degree gets: half its angle or its distance; rates; sine, cosine.
_PLACE, _RATE, _ACCELERATION, _SINE, _COSINE = 0, 1, 2, 3, 4


class Links(NamedTuple):
    """The links of a tree as `write_reactions` takes them.

    Attributes:
        parents: (nj,) row of each joint's parent, -1 for the ground.
        numbers: (nj, 22), see the names above.
        gravity: (3,) m/s^2.
    """

    parents: np.ndarray
    numbers: np.ndarray
    gravity: np.ndarray


def links(twin: Twin) -> Links:
    """Return the tables of a robot's links, made at the first call."""
    if "links" not in twin.pools:
        model = twin.model
        numbers = np.empty((twin.n_joints, _NUMBERS))
        for row, j in zip(numbers, range(1, model.njoints), strict=True):
            placement, body = model.jointPlacements[j], model.inertias[j]
            row[_PLACED:_AT], row[_AT:_MASS] = placement.rotation.ravel(), placement.translation
            row[_MASS], row[_CENTER:_INERTIA] = body.mass, body.lever
            row[_INERTIA:] = body.inertia[np.tril_indices(3)]
        parents = np.array(list(model.parents)[1:], dtype=np.int64) - 1
        twin.pools["links"] = Links(parents, numbers, np.array(model.gravity.linear))
    found: Links = twin.pools["links"]
    return found


_Three = tuple[Any, Any, Any]


def _three(rows: Any, first: int) -> _Three:
    return rows[first], rows[first + 1], rows[first + 2]


def _write(rows: Any, first: int, values: tuple[Any, ...]) -> None:
    for i, value in enumerate(values):
        rows[first + i] = value


def _cross(a: _Three, b: _Three) -> _Three:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _add(first: _Three, *more: _Three) -> _Three:
    x, y, z = first
    for other in more:
        x, y, z = x + other[0], y + other[1], z + other[2]
    return x, y, z


def _times(m: tuple[Any, ...], a: _Three) -> _Three:
    """A matrix (9 entries, row by row) times a vector."""
    x, y, z = (m[r] * a[0] + m[r + 1] * a[1] + m[r + 2] * a[2] for r in (0, 3, 6))
    return x, y, z


def _transposed(m: tuple[Any, ...]) -> tuple[Any, ...]:
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


def _rotation(x: Any, y: Any, z: Any, w: Any) -> tuple[Any, ...]:
    """The matrix of a unit quaternion."""
    dx, dy, dz = x + x, y + y, z + z
    return (
        *(1.0 - (y * dy + z * dz), x * dy - w * dz, x * dz + w * dy),
        *(x * dy + w * dz, 1.0 - (x * dx + z * dz), y * dz - w * dx),
        *(x * dz - w * dy, y * dz + w * dx, 1.0 - (x * dx + y * dy)),
    )


@on_lanes
def _turn(axis: Any, given: Any, own: Any) -> None:
    """State of a joint of one degree that turns; `axis` (6,) as in `Embedding`."""
    _write(own, _P, (0.0, 0.0, 0.0))
    _write(own, _R, tuple(axis[3 + i] * given[_SINE] for i in range(3)))
    own[_R + 3] = given[_COSINE]
    _write(own, _V, tuple(axis[i] * given[_RATE] for i in range(6)))
    _write(own, _A, tuple(axis[i] * given[_ACCELERATION] for i in range(6)))


@on_lanes
def _slide(axis: Any, given: Any, own: Any) -> None:
    """The same of one that slides."""
    _write(own, _P, tuple(axis[i] * given[_PLACE] for i in range(3)))
    _write(own, _R, (0.0, 0.0, 0.0, 1.0))
    _write(own, _V, tuple(axis[i] * given[_RATE] for i in range(6)))
    _write(own, _A, tuple(axis[i] * given[_ACCELERATION] for i in range(6)))


@on_lanes
def _outwards(numbers: Any, up: Any, own: Any) -> None:
    """Placement, velocity, acceleration and wrench of a link from its joint's state."""
    placed = tuple(numbers[_PLACED + i] for i in range(9))
    columns = _transposed(_rotation(own[_R], own[_R + 1], own[_R + 2], own[_R + 3]))
    turned = (_times(placed, columns[c : c + 3]) for c in (0, 3, 6))
    back = tuple(entry for column in turned for entry in column)  # R^T: to the child's frame
    p = _add(_three(numbers, _AT), _times(placed, _three(own, _P)))
    t, turn = _three(own, _V), _three(own, _V + 3)
    t_rate, turn_rate = _three(own, _A), _three(own, _A + 3)
    v, w = _three(up, _V), _three(up, _V + 3)
    a, alpha = _three(up, _A), _three(up, _A + 3)
    v, a = _times(back, _add(v, _cross(w, p))), _times(back, _add(a, _cross(alpha, p)))
    w, alpha = _times(back, w), _times(back, alpha)
    v, w = _add(v, t), _add(w, turn)
    a = _add(a, t_rate, _cross(w, t), _cross(v, turn))
    alpha = _add(alpha, turn_rate, _cross(w, turn))
    m, center = numbers[_MASS], _three(numbers, _CENTER)
    xx, xy, yy, xz, yz, zz = (numbers[_INERTIA + i] for i in range(6))
    inertia = xx, xy, xz, xy, yy, yz, xz, yz, zz
    x, y, z = _add(v, _cross(w, center))
    momentum = m * x, m * y, m * z
    spin = _add(_times(inertia, w), _cross(center, momentum))
    x, y, z = _add(a, _cross(alpha, center))
    force = m * x, m * y, m * z
    moment = _add(_times(inertia, alpha), _cross(center, force))
    _write(own, _P, p)
    _write(own, _R, _transposed(back))
    _write(own, _V, v + w)
    _write(own, _A, a + alpha)
    _write(own, _F, _add(force, _cross(w, momentum)))
    _write(own, _F + 3, _add(moment, _cross(w, spin), _cross(v, momentum)))


@on_lanes
def _inwards(up: Any, own: Any) -> None:
    """Add a joint's wrench to that of its parent."""
    R = tuple(own[_R + i] for i in range(9))
    force = _times(R, _three(own, _F))
    moment = _add(_times(R, _three(own, _F + 3)), _cross(_three(own, _P), force))
    _write(up, _F, _add(_three(up, _F), force))
    _write(up, _F + 3, _add(_three(up, _F + 3), moment))


#: 2 / pi; pi / 2 in three parts, of which n times the first two is exact for whole n < 2^20.
_PER_QUARTER = 0.6366197723675814
_QUARTER = 1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21
#: Beyond, n times what the third part leaves out would be seen in a sine near 0.
_LARGEST_ANGLE = 1e5
#: Adding it rounds a number below 2^51 to a whole one.
_ROUNDING = 6755399441055744.0
#: Coefficients of sine and cosine on [-pi/4, pi/4] (Sun's fdlibm, k_sin.c and k_cos.c), largest
#: power first.
_SINES = (
    *(1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06),
    *(-1.98412698298579493134e-04, 8.33333333332248946124e-03),
)
_SIXTH = -1.66666666666666324348e-01
_COSINES = (
    *(-1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07),
    *(2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02),
)


def _polynomial(coefficients: tuple[float, ...], x: Any) -> Any:
    total = x * coefficients[0] + coefficients[1]
    for coefficient in coefficients[2:]:
        total = total * x + coefficient
    return total


def _rounded(x: Any) -> Any:
    return (x + _ROUNDING) - _ROUNDING


@on_lanes
def _sine_cosine(given: Any) -> None:
    """Sine and cosine of angles up to `_LARGEST_ANGLE`, to less than one unit in the last place.

    As fdlibm computes them: an angle less n quarters of a turn as y + tail, then polynomials.
    """
    angle = given[_PLACE]
    n = _rounded(angle * _PER_QUARTER)
    most = angle - n * _QUARTER[0]
    part = n * _QUARTER[1]
    left = most - part
    rest = n * _QUARTER[2] - ((most - left) - part)
    y = left - rest
    tail = (left - y) - rest
    square = y * y
    cube = square * y
    sine = y - ((square * (0.5 * tail - cube * _polynomial(_SINES, square)) - tail) - cube * _SIXTH)
    half = 0.5 * square
    about = 1.0 - half
    cosine = about + (
        ((1.0 - about) - half) + (square * (square * _polynomial(_COSINES, square)) - y * tail)
    )
    place = n - 4.0 * _rounded(0.25 * n)  # -2 to 2
    off_axis = place * place - 1.0
    even = off_axis * off_axis > 0.5
    of_sine, of_cosine = where(even, sine, cosine), where(even, cosine, sine)
    before, after = place - 0.5, place + 0.5
    given[_SINE] = where(before * before > 1.0, -of_sine, of_sine)
    given[_COSINE] = where(after * after > 1.0, -of_cosine, of_cosine)


@kernel
def write_reactions(
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    joints: Embedding,
    tree: Links,
    wrench: np.ndarray,
) -> None:
    """Write the wrench that every joint transmits, parent on child, in the child's joint frame.

    Args:
        q, v, a: (n, nq), (n, nv), (n, nv) of the robot.
        wrench: (n, nj, 6), N and N m, overwritten.
    """
    n, nj = q.shape[0], joints.kind.size
    rows = np.empty((nj + 2, _ROWS, LANES))  # the ground, the joints, then what one is given
    given = rows[nj + 1]
    for e in range(_ROWS):
        for lane in range(LANES):
            rows[0, e, lane] = -tree.gravity[e - _A] if _A <= e < _A + 3 else 0.0
    for first in range(0, n, LANES):
        for j in range(nj):
            k, iq, iv, own = joints.kind[j], joints.q_index[j], joints.v_index[j], rows[1 + j]
            ratio, shift, components = joints.ratio[j], joints.shift[j], joints.components[j]
            for lane in range(LANES):
                i = first + lane if first + lane < n else n - 1
                if k > CONTINUOUS:
                    state = own[_P:, lane], own[_V:, lane], own[_A:, lane]
                    embed_many(k, q[i, iq:], v[i, iv:], a[i, iv:], components, *state)
                    continue
                if k == CONTINUOUS:
                    given[_PLACE, lane] = 0.5 * np.arctan2(q[i, iq + 1], q[i, iq])
                else:
                    place = ratio * q[i, iq] + shift
                    given[_PLACE, lane] = place if k == PRISMATIC else 0.5 * place
                given[_RATE, lane], given[_ACCELERATION, lane] = ratio * v[i, iv], ratio * a[i, iv]
            if k == PRISMATIC:
                _slide(joints.axis[j], given, own)
            elif k <= CONTINUOUS:
                _sine_cosine(given)
                for lane in range(LANES):
                    if not abs(given[_PLACE, lane]) <= _LARGEST_ANGLE:
                        given[_SINE, lane] = np.sin(given[_PLACE, lane])
                        given[_COSINE, lane] = np.cos(given[_PLACE, lane])
                _turn(joints.axis[j], given, own)
            _outwards(tree.numbers[j], rows[1 + tree.parents[j]], own)
        for j in range(nj - 1, -1, -1):
            _inwards(rows[1 + tree.parents[j]], rows[1 + j])
        for i in range(first, n if n - first < LANES else first + LANES):
            for j in range(nj):
                for e in range(6):
                    wrench[i, j, e] = rows[1 + j, _F + e, i - first]
