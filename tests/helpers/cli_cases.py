from pathlib import Path

import pytest

from pinfric import cli
from pinfric.model.files import RECORD

ROOT = Path(__file__).parents[2]


URDF = """<robot name="arm">
  <link name="base"/>
  <link name="link"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="link"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>"""


SCENE = """
pinfric: 1
robot: {urdf: arm.urdf}
friction: {shoulder: {bearing: {kind: pin, radius: 0.05}, mu: {static: 0.2, kinetic: 0.1}}}
"""


WAY = """
pinfric_trajectory: 1
sample_rate: 50
points:
  - {q: [0.0], hold: 0.2}
  - {q: [1.0], duration: 1.0, hold: 0.4}
"""


def run(*arguments):
    """Exit code of `pinfric ARGUMENTS`, in this process."""
    with pytest.raises(SystemExit) as ended:
        cli.main([*map(str, arguments)])
    return ended.value.code


def told(capsys, *arguments, code=0):
    """What `pinfric ARGUMENTS` prints, as (out, err); it must end with `code`."""
    assert run(*arguments) == code
    return capsys.readouterr()


def refused(capsys, *arguments):
    """The one line on stderr with which `pinfric ARGUMENTS` refuses bad input."""
    out, err = told(capsys, *arguments, code=cli.BAD_INPUT)
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("pinfric: error: ")
    return err


def results_in(folder):
    """The names of the files that a command wrote into a folder, without its record."""
    return sorted(path.name for path in Path(folder).iterdir() if path.name != RECORD)
