"""Pinocchio 4's joint friction constraint with the exported bounds: it holds and it slips."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump

import pinfric as pf

STEP = 1e-3


def hinge(dry=3.0, viscous=0.5):
    body = lump(1.0, moment=1.0)
    friction = {"coulomb": {"static": dry, "kinetic": dry}, "viscous": viscous}
    return pf.Scene(chain(("hinge", pin.JointModelRZ(), body)), friction={"hinge": friction})


def constrained(text, model):
    """What an exported file gives a model."""
    read = {}
    exec(text, read)
    return read["set_friction"](model)


def impulse(model, constraint, v, effort):
    """Impulses (N m s) that Pinocchio's solver finds over one step."""
    data, q = model.createData(), pin.neutral(model)
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    free = v + STEP * np.linalg.solve(M, effort - pin.nonLinearEffects(model, data, q, v))
    constraint.setTimeStep(STEP)
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    models.append(pin.ConstraintModel(constraint))
    datas.append(models[0].createData())
    settings, result = pin.PGSSolverSettings(), pin.PGSSolverResult()
    settings.max_iterations = 1000
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-13
    delassus = pin.DelassusOperatorDense(np.linalg.inv(M))
    assert pin.PGSConstraintSolver(model.nv).solve(delassus, free, models, datas, settings, result)
    return result.retrieveConstraintImpulses()


@pytest.mark.parametrize(
    ("effort", "friction"), [(2.0, -2.0), (-2.9, 2.9), (5.0, -3.0), (-5.0, 3.0)]
)
def test_the_constraint_holds_by_up_to_the_bound(effort, friction):
    scene = hinge()
    model = scene.model.copy()
    constraint = constrained(pf.export(scene, to="pinocchio").text, model)
    found = impulse(model, constraint, np.zeros(1), np.array([effort]))
    assert found[0] == pytest.approx(friction * STEP, rel=1e-6)
    assert model.damping[0] == pytest.approx(0.5)


def test_bounds_and_errors_are_those_of_the_export():
    scene = pf.load_scene("ur5_pick_and_place")
    made = pf.export(scene, pf.load_trajectory("ur5_pick_and_place.csv", scene), "pinocchio")
    model = scene.loaded_model()
    constraint = constrained(made.text, model)
    dry = np.array([joint.frictionloss for joint in made.joints])
    np.testing.assert_array_equal(constraint.getFrictionUpperLimit(), dry)
    np.testing.assert_array_equal(constraint.getFrictionLowerLimit(), -dry)
    np.testing.assert_array_equal(model.upperDryFrictionLimit, dry)
    v = np.array([0.5, -0.4, 0.6, -0.5, 0.3, -0.7])
    sliding = impulse(model, constraint, v, np.zeros(6)) / STEP
    np.testing.assert_allclose(sliding, -dry * np.sign(v), rtol=1e-6, atol=1e-9)
    # rotors are in the model: what rnea of it takes beyond the scene's is armature a
    a = np.linspace(1.0, 2.0, 6)
    q, plain = pin.neutral(model), scene.loaded_model()
    more = pin.rnea(model, model.createData(), q, v, a) - pin.rnea(
        plain, plain.createData(), q, v, a
    )
    np.testing.assert_allclose(more, [joint.armature for joint in made.joints] * a, atol=1e-9)
    assert made.text.count("; error rms ") == 6


def test_a_joint_that_is_not_there_is_named():
    text = pf.export(hinge(), to="pinocchio").text
    with pytest.raises(KeyError, match="there is no joint 'hinge'"):
        constrained(text, pin.buildSampleModelManipulator())
