"""Laws and gears of many samples at once: factors on the numbers of the scene's own tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.dynamics.samples.motor_torques import scene_gears
from pinfric.model.drives import Gears
from pinfric.model.friction_terms import CONSTANT, FrictionTerm, Stribeck
from pinfric.model.laws import Laws, friction_law, law_table
from pinfric.model.scene import Scene
from pinfric.model.schema import Friction
from pinfric.sweeps.parameters import Target

#: Which components of a `Strength` a factor acts on, by the direction it names.
_WAYS = {"": slice(0, 3), "positive": slice(1, 2), "negative": slice(2, 3)}


def laws_of_samples(scene: Scene, targets: Sequence[Target], values: np.ndarray) -> Laws:
    """Return `law_table` of each sample: strengths (n, ...), n = 1 where friction does not vary.

    Every term is a sum of strengths, and a factor on it multiplies them.

    Args:
        scene: before the values are put in.
        targets, values: (n, number of targets).
    """
    terms = [(site, key) for site in scene.sites for key in _keys(site.friction)]
    table = law_table(
        [friction_law(_only(site.friction, key), site.law.stick_velocity) for site, key in terms]
    )
    varied = [j for j, target in enumerate(targets) if target.section == "friction"]
    factor = np.ones((len(values) if varied else 1, len(terms), 3))
    for j in varied:
        key, _, way = targets[j].key.partition(".")
        for i, (site, of) in enumerate(terms):
            if site.name in targets[j].names and of == key:
                factor[:, i, _WAYS[way]] *= values[:, j, None]
    counts = [len(_keys(site.friction)) for site in scene.sites]
    first = np.cumsum([0, *counts], dtype=np.int64)[:-1]
    last = first + np.array(counts, dtype=np.int64) - 1
    of_row = np.repeat(np.arange(len(terms)), table.row_end - table.row_start)

    def summed(strength: np.ndarray) -> np.ndarray:
        return np.add.reduceat(strength, first, axis=1) if len(first) else strength

    mu, forces = factor[:, :, 0], factor[:, :, 1:]
    found = table._replace(
        mu_static=summed(mu * table.mu_static),
        mu_kinetic=summed(mu * table.mu_kinetic),
        coulomb_static=summed(forces * table.coulomb_static),
        coulomb_kinetic=summed(forces * table.coulomb_kinetic),
        viscous=summed(forces[:, :, 0] * table.viscous),
        stick_velocity=table.stick_velocity[first],
        row_start=table.row_start[first],
        row_end=table.row_end[last],
        mu=mu[:, of_row] * table.mu,
        coulomb=forces[:, of_row] * table.coulomb,
    )
    return Laws(*map(np.ascontiguousarray, found))  # another layout is another kernel


def gears_of_samples(scene: Scene, targets: Sequence[Target], values: np.ndarray) -> Gears:
    """Return `gear_table` of each sample: what varies (n, ...), n = 1 where no gear does.

    Args: as `laws_of_samples`.
    """
    gears = scene_gears(scene)
    varied = [j for j, target in enumerate(targets) if target.section == "transmission"]
    factor = {
        name: np.ones((len(values) if varied else 1, *getattr(gears, name).shape))
        for name in ("no_load", "viscous", "rotor_inertia")
    }
    for j in varied:
        key, _, way = targets[j].key.partition(".")
        name = {"no_load_torque": "no_load", "motor_viscous": "viscous"}.get(key, key)
        for d, drive in enumerate(scene.drives):
            if drive.name in targets[j].names:
                one = factor[name][:, d]
                if way:  # the motor's: a ratio below 0 turns it round
                    one = one[:, int((way == "positive") != (gears.ratio[d] > 0))]
                one *= values[:, j].reshape(-1, *[1] * (one.ndim - 1))
    return gears._replace(
        no_load=factor["no_load"] * gears.no_load,
        no_load_static=factor["no_load"] * gears.no_load_static,
        viscous=factor["viscous"] * gears.viscous,
        rotor_inertia=factor["rotor_inertia"] * gears.rotor_inertia,
    )


def proportional(term: FrictionTerm) -> bool:
    """Whether a factor on a term multiplies its strengths and nothing else: its class decides."""
    stribeck = Stribeck(velocity=1.0)
    once, twice = (
        ((CONSTANT, one.at_rest()), *one.rows(stribeck)) for one in (term, term.scaled(2.0))
    )
    return twice == tuple((shape, tuple(2.0 * x for x in strength)) for shape, strength in once)


def _keys(friction: Friction) -> list[str]:
    """The keys of a site's terms; one that has none keeps a row of zeros."""
    return list(friction.named_terms) or [""]


def _only(friction: Friction, key: str) -> Friction:
    """The entry with one of its terms."""
    others = {
        name: None for name, term in friction if isinstance(term, FrictionTerm) and name != key
    }
    return friction.model_copy(update=others)
