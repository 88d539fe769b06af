"""Frequencies against closed forms, the full matrices, and MuJoCo's linearization."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from pinfric.elastic.vibration import (
    bracket,
    free_motions,
    frequencies,
    has_light,
    lowest_frequencies,
    lowest_mode,
    mobility,
)

TAU = 2 * np.pi


def none(n: int, nv: int) -> np.ndarray:
    return np.zeros((n, 0, nv))


def spd(rng: np.random.Generator, *shape: int) -> np.ndarray:
    A = rng.normal(size=shape)
    return A @ np.swapaxes(A, -1, -2) + 0.05 * np.eye(shape[-1])


def test_one_axis():
    J, K, rotor = 3.0, 2e4, 0.7
    moved = mobility(np.array([[[J]]]), np.ones((1, 1, 1)), none(1, 1))
    held, free = (frequencies(moved + extra, np.array([[K]])) for extra in (0.0, 1 / rotor))
    assert held == pytest.approx(np.sqrt(K / J) / TAU, rel=1e-14)
    assert free == pytest.approx(np.sqrt(K * (1 / J + 1 / rotor)) / TAU, rel=1e-14)
    low, high = bracket(np.array([[J]]), np.array([[K]]))
    assert low == pytest.approx(held[0]) == high


def test_two_axes_against_the_quadratic():
    """det(K - w^2 M) = (M11 M22 - M12^2) w^4 - (K1 M22 + K2 M11) w^2 + K1 K2 = 0."""
    (a, b), c, (k1, k2) = (5.0, 1.2), 1.9, (3e4, 1e4)
    square = np.sort(np.roots([a * b - c * c, -(k1 * b + k2 * a), k1 * k2]))
    M, K = np.array([[[a, c], [c, b]]]), np.array([[k1, k2]])
    found = frequencies(mobility(M, np.eye(2)[None], none(1, 2)), K)[0]
    np.testing.assert_allclose(found, np.sqrt(square) / TAU, rtol=1e-13)
    np.testing.assert_allclose(lowest_frequencies(M, K), found[:1], rtol=1e-9)
    mode = lowest_mode(M[0], np.eye(2), none(1, 2)[0], K[0])
    x = np.linalg.svd(np.diag(K[0]) - square[0] * M[0])[2][-1]
    np.testing.assert_allclose(mode.shape, x / x[np.argmax(abs(x))], atol=1e-12)
    np.testing.assert_allclose(mode.shares, K[0] * x**2 / (K[0] @ x**2), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_any_mechanism_against_its_full_matrices(seed):
    """Couples, loops and rigid drives: K_z = Z^T S^T K S Z beside Z^T M Z; free: q and theta."""
    rng = np.random.default_rng(seed)
    nv, ne = 6, 3
    M, S = spd(rng, nv, nv), rng.normal(size=(ne, nv))
    loops, rigid = rng.normal(size=(2, nv)), rng.normal(size=(1, nv))
    K, rotor = rng.uniform(1e3, 1e5, ne), rng.uniform(0.1, 2.0, ne)
    closed = np.concatenate([loops, rigid])
    Z = scipy.linalg.null_space(closed)
    held = scipy.linalg.eigvalsh(Z.T @ S.T @ np.diag(K) @ S @ Z, Z.T @ M @ Z)
    found = frequencies(mobility(M[None], S[None], closed[None]), K[None])[0]
    np.testing.assert_allclose(found, np.sqrt(held) / TAU, rtol=1e-9)

    Z = scipy.linalg.null_space(loops)
    stiff = np.block([[S.T * K @ S, -S.T * K], [-(K[:, None] * S), np.diag(K)]])
    full = scipy.linalg.block_diag(Z, np.eye(ne))
    mass = scipy.linalg.block_diag(M, np.diag(rotor))
    free = scipy.linalg.eigvalsh(full.T @ stiff @ full, full.T @ mass @ full)[-ne:]
    moved = mobility(M[None], S[None], loops[None]) + np.diag(1 / rotor)
    np.testing.assert_allclose(frequencies(moved, K[None])[0], np.sqrt(free) / TAU, rtol=1e-9)


def test_springs_that_outnumber_the_motions_have_no_frequency_of_their_own():
    M, S = np.array([[[2.0]]]), np.array([[[1.0], [3.0]]])
    found = frequencies(mobility(M, S, none(1, 1)), np.array([[5.0, 7.0]]))[0]
    assert found[0] == pytest.approx(np.sqrt((5 + 9 * 7) / 2) / TAU)
    assert np.isnan(found[1])


def test_a_spring_that_carries_no_mass_is_as_if_it_carried_hardly_any():
    """Judge: the same with 1e-10 of the mass, by K_z beside M_z; the light mode is far above."""
    rng = np.random.default_rng(3)
    nv, ne, tiny = 5, 4, 1e-10
    heavy = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
    M = heavy @ spd(rng, nv, nv) @ heavy
    S, closed, K = rng.normal(size=(ne, nv)), rng.normal(size=(1, nv)), rng.uniform(1e3, 1e5, ne)
    Z = scipy.linalg.null_space(closed)
    almost = Z.T @ (M + tiny * np.eye(nv)) @ Z
    period, motion = scipy.linalg.eigh(almost, Z.T @ S.T @ np.diag(K) @ S @ Z)  # 1/w^2
    mode = lowest_mode(M, S, closed, K)
    assert has_light(M[None], closed[None])
    assert mode.frequency == pytest.approx(period[-1] ** -0.5 / TAU, rel=1e-7)
    strain = K * (S @ Z @ motion[:, -1]) ** 2
    np.testing.assert_allclose(mode.shares, strain / strain.sum(), atol=1e-7)


@pytest.mark.parametrize("k", [1, 2, 6])
def test_lowest_frequencies_are_those_of_all(k):
    """Random matrices, close pairs and sudden changes of the mode among them."""
    rng = np.random.default_rng(k)
    mass, K = spd(rng, 400, k, k), rng.uniform(1e3, 1e5, (400, k))
    mass[::7] = np.eye(k) * rng.uniform(1, 2, k)
    mass[::14] = np.eye(k)
    K[::21] = 1e4
    whole = frequencies(np.linalg.inv(mass), K)[:, 0]
    np.testing.assert_allclose(lowest_frequencies(mass, K), whole, rtol=1e-9)


def test_the_bracket_holds_and_its_upper_end_is_the_rule_of_one_joint():
    rng = np.random.default_rng(2)
    mass, K = spd(rng, 300, 6, 6), rng.uniform(1e3, 1e5, (300, 6))
    first = lowest_frequencies(mass, K)
    low, high = bracket(mass[:, range(6), range(6)], K)
    assert (low <= first * (1 + 1e-8)).all()
    assert (first <= high * (1 + 1e-8)).all()
    rule = np.sqrt(K / mass[:, range(6), range(6)]).min(axis=1) / TAU
    np.testing.assert_allclose(high, rule, rtol=1e-12)


def test_free_motions_obey_their_rows():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(5, 3, 6))
    rows[:, 2] = rows[:, 0] - rows[:, 1]  # one of them says nothing new
    N = free_motions(rows, 6)
    assert N.shape == (5, 6, 4)
    np.testing.assert_allclose(rows @ N, 0.0, atol=1e-12)


ARM = """
<mujoco><option timestep="1e-6" gravity="0 0 0" integrator="Euler"/>
<worldbody>
 {rotor1}
 <body><joint name="q1" axis="0 1 0" {spring1}/>
  <inertial pos="0 0 .4" mass="8" diaginertia=".3 .35 .05"/>
  {rotor2}
  <body pos="0 0 .7"><joint name="q2" axis="0 1 0" {spring2}/>
   <inertial pos="0 0 .3" mass="5" diaginertia=".12 .15 .04"/></body></body>
</worldbody>{tendons}</mujoco>"""
_ROTOR = """<body{at}><joint name="r{n}" axis="0 1 0" armature="{I}"/>
 <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/></body>"""
_TENDON = """<fixed name="s{n}" stiffness="{K}" springlength="0">
 <joint joint="q{n}" coef="-1"/><joint joint="r{n}" coef="1"/></fixed>"""


def by_mujoco(xml: str, q: dict[str, float]) -> np.ndarray:
    """Frequencies, Hz, of MuJoCo's own linearization (`mjd_transitionFD`), zeros left out."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for name, angle in q.items():
        data.joint(name).qpos[0] = angle
    nv = model.nv
    A = np.zeros((2 * nv, 2 * nv))
    mujoco.mjd_transitionFD(model, data, 1e-7, True, A, None, None, None)
    accelerations = A[nv:, :nv] / model.opt.timestep  # d qacc / d q
    squares = np.sort(np.linalg.eigvals(-accelerations).real)
    return np.sqrt(squares[squares > 1e-3 * squares[-1]]) / TAU


def arm_mass(elbow: float) -> np.ndarray:
    """M of the arm above: point masses, lengths and moments written out."""
    far = 0.7**2 + 0.3**2 + 2 * 0.7 * 0.3 * np.cos(elbow)
    a = 0.35 + 8 * 0.4**2 + 0.15 + 5 * far
    c = 0.15 + 5 * (0.3**2 + 0.7 * 0.3 * np.cos(elbow))
    return np.array([[a, c], [c, 0.15 + 5 * 0.3**2]])


@pytest.mark.parametrize("elbow", [0.0, 1.1])
def test_mujoco_linearizes_the_same_arm_to_eight_digits(elbow):
    K, rotor = np.array([3.1e4, 1.0e4]), np.array([0.68, 0.13])
    q = {"q2": elbow, "r2": elbow}
    springs = {
        f"spring{n}": f'stiffness="{k}" springref="{ref}"'
        for n, k, ref in ((1, K[0], 0.0), (2, K[1], np.degrees(elbow)))
    }
    held_model = ARM.format(rotor1="", rotor2="", tendons="", **springs)
    held = by_mujoco(held_model, {"q2": elbow})
    tendons = "".join(_TENDON.format(n=n, K=k) for n, k in zip((1, 2), K, strict=True))
    rotors = [
        _ROTOR.format(n=n, I=i, at=at)
        for n, i, at in ((1, rotor[0], ""), (2, rotor[1], ' pos="0 0 .7"'))
    ]
    free = by_mujoco(
        ARM.format(
            rotor1=rotors[0],
            rotor2=rotors[1],
            spring1="",
            spring2="",
            tendons=f"<tendon>{tendons}</tendon>",
        ),
        q,
    )
    moved = mobility(arm_mass(elbow)[None], np.eye(2)[None], none(1, 2))
    np.testing.assert_allclose(held, frequencies(moved, K[None])[0], rtol=1e-8)
    np.testing.assert_allclose(free, frequencies(moved + np.diag(1 / rotor), K[None])[0], rtol=1e-8)
