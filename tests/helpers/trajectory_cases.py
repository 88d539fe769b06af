from pathlib import Path
from types import SimpleNamespace

import pinocchio as pin
import pytest
from builders import chain

from pinfric.errors import PinfricError, TrajectoryError
from pinfric.motions.trajectory import load_trajectory


def arm_scene(**attached):
    """A revolute joint a (+-2 rad, 1 rad/s), a slide b (0 to 0.5 m, 0.5 m/s), a wheel c."""
    model = chain(("a", pin.JointModelRZ()), ("b", pin.JointModelPX()), ("c", pin.JointModelRUBY()))
    model.velocityLimit[:2] = 1.0, 0.5
    model.lowerPositionLimit[:2], model.upperPositionLimit[:2] = (-2.0, 0.0), (2.0, 0.5)
    payloads = {name: SimpleNamespace(attached=value) for name, value in attached.items()}
    return SimpleNamespace(model=model, payloads=payloads)


def one_joint_scene(**attached):
    model = chain(("a", pin.JointModelRZ()))
    model.velocityLimit[:] = 1.5
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2.0, 2.0
    payloads = {name: SimpleNamespace(attached=value) for name, value in attached.items()}
    return SimpleNamespace(model=model, payloads=payloads)


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def message(path, scene) -> str:
    with pytest.raises(TrajectoryError) as caught:
        load_trajectory(path, scene)
    assert isinstance(caught.value, PinfricError)
    assert str(path) in str(caught.value)
    return str(caught.value)
