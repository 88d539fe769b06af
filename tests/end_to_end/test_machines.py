"""Choices for whole machines with the bundled catalogue, beside the machines themselves."""

import numpy as np
import pytest
import yaml
from machines import MACHINES, rows

#: Peak efforts that the makers' URDFs give the joints, N m.
OWN = yaml.safe_load("""
ur10_machine_tending: [330, 330, 150, 54, 54, 54]
ur5_pick_and_place: [150, 150, 150, 28, 28, 28]
panda_pick_and_place: [87, 87, 87, 87, 12, 12, 12]
xarm7: [50, 50, 30, 30, 30, 20, 20]
""")
#: Repeated peak torques of CSG-14 to 65, ratio 100, N m (Harmonic Drive, CSF/CSG catalogue).
SERIES = [36, 70, 107, 204, 433, 738, 982, 1274, 2067, 2990]


@pytest.mark.slow
@pytest.mark.parametrize("name", OWN)
def test_arms_are_moved_by_strain_wave_gears_of_the_size_of_their_own(name):
    """The cycle stays below the joints' torques; half of the gears are within a size of their own.

    Sizes are those of a strain wave gear's series by its printed repeated peaks, each 1.3 to 2.1
    times the one before.
    """
    found = list(rows(name))
    assert [row.limit for row in found] == OWN[name]
    assert all(row.choice for row in found)
    for row in found:
        assert row.peak < row.limit
        assert row.bears > row.peak
    # a Panda's last joint takes a small planetary gear, whose backlash is said
    others = [row.axis for row in found if "CSG" not in row.choice]
    assert others == ["panda_joint7"] * (name == "panda_pick_and_place")
    chosen, own = (
        np.searchsorted(SERIES, [getattr(row, what) for row in found])
        for what in ("bears", "limit")
    )
    assert np.median(np.abs(chosen - own)) <= 1


def test_a_scaras_arms_fit_and_its_quill_does_not():
    shoulder, elbow, lift = rows("scara")
    assert "Harmonic Drive" in shoulder.choice
    assert "Harmonic Drive" in elbow.choice
    assert lift.choice is None  # 0.47 m/s: no complete screw of the catalogue is so fast
    assert any("PBSA ball screw" in name for name in lift.asked)


def test_a_bench_gantry_takes_complete_screws():
    found = list(rows("gantry"))
    assert all("maxon GP" in row.choice for row in found)
    assert sum(row.mass for row in found) < 1.0
    assert all(any("PBC" in name for name in row.asked) for row in found)  # forces unread


@pytest.mark.slow
def test_a_delta_takes_strain_wave_gears_and_an_excavator_none():
    """Planetary gears of its size lack their stiffness: they cannot be signed."""
    for row in rows("delta"):
        assert "CSG-14-100" in row.choice
        assert row.bears > row.peak
        assert any("maxon GP" in name for name in row.asked)
    for row in rows("excavator"):
        assert row.choice is None
        assert "not for cylinders" in row.why
    assert set(MACHINES) >= {"scara", "gantry"}
