"""A compensator as a package of ROS 2: a chainable controller of ros2_control around the header."""

from __future__ import annotations

import json
import re
from xml.sax.saxutils import escape

from pinfric import __version__
from pinfric.dynamics.forward.compensation import freedom_names
from pinfric.exporting.cpp import CppFiles, named, template
from pinfric.exporting.tree import check_plain_tree
from pinfric.model.brief import file_name
from pinfric.model.scene import Scene

#: Files of the package beside the header and its test, by the templates that they are made of.
_FILES = {
    "package.xml": "package.xml",
    "CMakeLists.txt": "CMakeLists.txt",
    "controller_plugin.xml": "controller_plugin.xml",
    "controllers.yaml": "controllers.yaml",
    "pinfric_scene_controller.cpp": "controller.cpp",
}


def package_files(called: str) -> list[str]:
    """Return the names of a package's files beside the header and its test.

    Args:
        called: the header's name.
    """
    return [named(name, called) for name in _FILES]


def package(scene: Scene, files: CppFiles, frames: tuple[str, ...], called: str) -> dict[str, str]:
    """Return the package beside the header and its test: name -> text.

    Args:
        scene: an open chain whose drives act on one joint each.
        files: of the compensator, which is compiled into the controller.
        frames: of the header, for payloads.
        called: the header's name; in small letters the package's, as ROS 2 wants it.

    Raises:
        PinfricError: see `check_plain_tree`.

    Source: ros2_control, ChainableControllerInterface (Jazzy 4.46, Kilted 5.16, rolling 6.8).
    """
    check_plain_tree(scene)
    inner = re.search(r"inline namespace (\w+)", files.header)
    assert inner is not None
    joints = [json.dumps(name, ensure_ascii=False) for name in freedom_names(scene)]
    commanded = [f'"friction/{name[1:]}' for name in joints]
    marks = {
        "PACKAGE": called.lower(),
        "VERSION": __version__,
        "SCENE": escape(file_name(scene.source)),
        "HEADER": f"{called}.hpp",
        "INNER": inner[1],
        "JOINTS": ", ".join(joints),
        "COMMANDED": ", ".join(commanded),
        "FRAMES": "a payload's link: " + (", ".join(frames) or "none"),
    }
    texts = {}
    for name, source in _FILES.items():
        text = named(template(f"ros2/{source}"), called)
        for mark, said in marks.items():
            text = text.replace(f"@@{mark}", said)
        texts[named(name, called)] = text
    return texts
