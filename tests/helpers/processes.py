"""Linux's view of a process, its descendants and the ports they listen on."""

import ipaddress
import os
from pathlib import Path


def children(pid):
    """Every process below one, by /proc."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found += [int(child), *children(int(child))]
    return found


def workers(pid):
    """The processes below one that loky has started to compute."""
    return [
        p
        for p in children(pid)
        if b"loky.backend.popen_loky_posix" in Path(f"/proc/{p}/cmdline").read_bytes()
    ]


def sockets_of(pid):
    found = set()
    for entry in Path(f"/proc/{pid}/fd").glob("*"):
        try:
            found.add(os.readlink(entry))
        except OSError:
            continue
    return found


def listening(root):
    """(address, port) of every TCP socket on which a process or one of its descendants listens."""
    mine = set().union(*(sockets_of(pid) for pid in [root, *children(root)]))
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in mine:
                address, port = fields[1].split(":")
                found.add((ipaddress.ip_address(_bytes(address)), int(port, 16)))
    return found


def _bytes(address):
    """The kernel prints words of four bytes in the machine's order."""
    words = [bytes.fromhex(address[i : i + 8])[::-1] for i in range(0, len(address), 8)]
    return b"".join(words)
