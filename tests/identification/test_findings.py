"""What is found of friction behind a drive belongs to that drive."""

from identify_cases import NAMES


def test_friction_seen_through_the_drives_goes_when_other_drives_are_sized(found):
    through = {name for name, entry in found.scene.friction.items() if entry.includes_drive}
    assert through == set(NAMES) - {NAMES[1]}  # its gear's losses grow with it: it is the joint's
