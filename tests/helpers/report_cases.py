import io

from rich.console import Console

#: As a humanoid's hands have them, and longer.
FINGERS = [
    f"{side}_hand_{finger}_{part}_joint"
    for side in ("left", "right")
    for finger in ("thumb", "index", "middle", "ring", "little", "auxiliary")
    for part in ("abduction", "virtual_1", "proximal_flexion", "virtual_2")
]


def printed(renderables, width):
    console = Console(file=io.StringIO(), width=width, highlight=False)
    console.print(*renderables, sep="\n", crop=False)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]
