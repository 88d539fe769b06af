"""How much a motion would tell about friction, before its efforts are known.

    y_j = Y_j(q, v, a) theta + J_j a_j + X_j(v, load) beta_j + noise

Columns do not need efforts, so neither do the standard errors of beta with theta and J unknown:
those of the inverse of the Schur complement S of theta and J. D-optimal is a motion with the
largest log det S (Pukelsheim, Optimal Design of Experiments, 1993).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.identification.columns import regressors
from pinfric.identification.inertias import parameters, urdf_prior
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.couples import rate_rows
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import configurations, joint_columns

#: Columns of a joint: rotor; Coulomb forward and backward, viscous, load.
_OWN = 5
#: Share of a joint's fastest motion, and of the largest effort by gravity, below which it does not
#: slide, and its load is none.
_SLIDES, _LOADED = 0.01, 0.02
#: Standard deviation of an effort, as a share of its RMS: only its size beside the prior counts.
_NOISE = 0.02
#: What keeps a coefficient without any row from being infinitely uncertain.
_LEAST = 1e-9


@dataclass(frozen=True)
class Criterion:
    """What a motion tells about the friction of a scene's joints.

    Attributes:
        scene: the robot. size: (nj,) RMS of the efforts, N m or N.
        loaded: (nj,) joints that gravity loads, whose friction may grow with it.
        links: (10 nj,) inverse variance of the links' parameters before any log.
    """

    scene: Scene
    size: FloatArray
    loaded: BoolArray
    links: FloatArray

    @classmethod
    def of(cls, scene: Scene, postures: FloatArray) -> Criterion:
        """Return the criterion for postures (n, nj) that a motion visits."""
        model, none = scene.model, np.zeros(scene.model.nv)
        data = model.createData()
        at_rest = np.array(
            [
                pin.rnea(model, data, q, none, none)
                for q in configurations(joint_columns(model), postures, model.nq)
            ]
        )
        gravity = np.sqrt(np.mean(at_rest**2, axis=0))
        size = np.maximum(gravity, 0.1 * gravity.max(initial=0.0)) + _LEAST
        deviation = urdf_prior(model, kept=False).deviation
        links = 1.0 / np.maximum(deviation, _LEAST * deviation.max(initial=1.0)) ** 2
        return cls(scene, size, gravity > _LOADED * gravity.max(initial=0.0), links)

    def products(self, position: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return (nj, p, p) products of each joint's columns over a motion, (T, nj) each."""
        model, nj = self.scene.model, self.scene.model.nv
        Y = regressors(self.scene, configurations(joint_columns(model), position, model.nq), v, a)
        rates = rate_rows(self.scene.drives, nj)
        v, a = v @ rates.T, a @ rates.T
        rigid = Y @ parameters(model)
        columns = [a, 1.0 * (v > 0.0), -1.0 * (v < 0.0), v, np.sign(v) * np.abs(rigid)]
        whole = np.concatenate((Y, np.stack(columns, axis=2)), axis=2)
        fastest = np.abs(v).max(axis=0, initial=_LEAST)
        whole *= (np.abs(v) > _SLIDES * fastest)[:, :, None] / (_NOISE * self.size[:, None])
        return np.asarray(np.einsum("tjp,tjq->jpq", whole, whole, optimize=True))

    def value(self, products: FloatArray) -> float:
        """Return log det S."""
        nj = len(products)
        p = 10 * nj
        whole = np.zeros((p + _OWN * nj, p + _OWN * nj))
        whole[:p, :p] = np.diag(self.links) + products[:, :p, :p].sum(axis=0)
        friction = np.zeros(len(whole), dtype=bool)
        for j, own in enumerate(products):
            at = slice(p + _OWN * j, p + _OWN * (j + 1))
            whole[:p, at], whole[at, :p], whole[at, at] = own[:p, p:], own[p:, :p], own[p:, p:]
            friction[at.start + 1 : at.stop - (not self.loaded[j])] = True
            if not self.loaded[j]:  # its load's column is none
                whole[at.stop - 1, :] = whole[:, at.stop - 1] = 0.0
        size = np.sqrt(np.diag(whole)) + _LEAST
        whole /= np.outer(size, size)
        whole[np.diag_indices(len(whole))] += _LEAST
        covariance = np.linalg.inv(whole)[np.ix_(friction, friction)]
        scale = 2.0 * np.log(size[friction])
        return float(scale.sum() - np.linalg.slogdet(covariance)[1])
