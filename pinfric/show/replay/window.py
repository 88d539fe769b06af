"""A meshcat window without a server: it keeps what is drawn, packed, for a page that shows it."""

from __future__ import annotations

from typing import Any


class RecordingWindow:
    """Keep the commands that a `meshcat.Visualizer(window=...)` sends, in msgpack.

    Attributes:
        commands: as `viewer.handle_command_bytearray` of meshcat's JavaScript takes them.
    """

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        import umsgpack  # type: ignore[import-untyped]

        self.commands.append(umsgpack.packb(command.lower()))
