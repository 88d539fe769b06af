"""Mutations of texts, YAML trees, URDFs, tables and archives, by a seed, for the fuzzer."""

from __future__ import annotations

import contextlib
import io
import json
import random
import re
import xml.etree.ElementTree as ElementTree

#: What a value in a YAML tree becomes; the callable ones make it of what was there.
NASTY = [
    *(float("nan"), float("inf"), -float("inf")),
    *(1e300, -1e300, 1e155, 1e30, 1e9, 1e-300, 5e-324),
    *(0, -1, 1, 0.0, -0.0, 2**70, -(2**63), 10**400, True, False, None),
    *("", "nan", "1e3", "x" * 5000, "naïve ☃ \u202e", "a\nb", "\x1b[31mred\x1b[0m"),
    *("../" * 50, "/dev/null", ".", "shoulder", "base"),
    *([], {}, [[]], [1, 2, 3], [0.0, 0.0, 0.0], {"a": 1}, {1: 2}),
]
NUMBERS = [
    *("nan", "inf", "-inf", "1e300", "-1e300", "1e155", "1e308", "1e20", "1e-300"),
    *("0", "-1", "-0.0", "1e6", "0x10", "1,5", "1_0", "1e", "½", "x", "true", "--1"),
    *("", " ", "1 2 3", "9" * 400, "\x00"),
    *(
        "2\u00a0",
        "\u20092",
        "\uff12",
        "\u0967",
        "2\t",
        "+2.",
        "0_0.1",
        "2f",
        "2d0",
        "1e-400",
        "1e400",
    ),
]
#: Names of joints and links, wherever they stand.
NAMES = [
    "关节",
    "\U00012000",
    "a b",
    "a.v",
    "t",
    "\u202e",
    "é" * 300,
    "1",
    "-",
    "#x",
    "a/b",
    "a,b",
]


class Mutator:
    """Changes texts and trees at random."""

    def __init__(self, seed):
        self.chance = random.Random(seed)

    def factor(self):
        """A random factor on a number, often so near to 1 that the number may be meant."""
        chance = self.chance
        if chance.random() < 0.7:
            return chance.choice((0.01, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 100.0))
        return 10.0 ** chance.choice((-300, -150, -30, -9, -3, 3, 6, 9, 30, 150, 300))

    def number(self, word):
        """Another number in place of a word, or none."""
        try:
            changed = repr(float(word) * self.factor())
        except ValueError:
            changed = "1"
        return self.chance.choices((changed, self.chance.choice(NUMBERS)), (2, 1))[0]

    def text(self, text):
        """A text with one to three small mutations."""
        chance, text = self.chance, str(text)
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            lines = text.splitlines(keepends=True) or [""]
            row, place = chance.randrange(len(lines)), chance.randrange(len(text) + 1)
            numbers = list(re.finditer(r"-?\d+\.?\d*(e-?\d+)?", text))
            kind = chance.randrange(12)
            if kind == 0:
                del lines[row]
                text = "".join(lines)
            elif kind == 1:
                lines.insert(row, lines[row])
                text = "".join(lines)
            elif kind == 2:
                letter = chance.choice("\x00\t:{}[]&*!|>'\"%@`,#\n\\<>/=é☃-.0e\u2028\ufeff")
                text = text[:place] + letter + text[place:]
            elif kind == 3:
                text = text[:place] + text[place + chance.randrange(1, 9) :]
            elif kind == 4:
                text = text[:place]
            elif kind == 5:
                other = chance.randrange(len(lines))
                lines[row], lines[other] = lines[other], lines[row]
                text = "".join(lines)
            elif numbers:
                found = chance.choice(numbers)
                text = text[: found.start()] + self.number(found.group()) + text[found.end() :]
        return text

    def tree(self, tree):
        """A copy of a tree with one to three entries changed."""
        tree = json.loads(json.dumps(tree))
        for _ in range(self.chance.choice((1, 1, 1, 2, 3))):
            places = list(self._places(tree))
            if not places:
                break
            self._wound(*self.chance.choice(places))
        return tree

    def _places(self, node):
        for key in node if isinstance(node, dict) else range(len(node)):
            yield node, key
            if isinstance(node[key], dict | list):
                yield from self._places(node[key])

    def _wound(self, node, key):
        chance, value = self.chance, node[key]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        kind = chance.randrange(10)
        if number and kind < 7:
            factor = self.factor()
            if key in ("hold", "duration", "t_end", "sample_rate"):
                factor = min(factor, 10.0)  # a long motion is honest work
            changed = value * factor if abs(value) < 1e300 else 1.0  # an int may be too long
            others = changed, -value, chance.choice(NASTY[:19])
            (node[key],) = chance.choices(others, (6, 1, 2))
        elif kind < 7:
            node[key] = chance.choice(NASTY)
        elif kind == 7:
            del node[key]
        elif kind == 8 and isinstance(node, dict):
            name = chance.choice(("x" * 3000, key + "s", key.upper(), "", "ünï", "a\nb", "\x1b[1m"))
            node[name] = node.pop(key)
        elif isinstance(node, dict):
            node[chance.choice(list(node))] = value
        else:
            node.insert(key, value)

    def xml(self, text):
        """A URDF with one or two attributes or elements changed."""
        chance = self.chance
        if chance.random() < 0.3:
            return self.text(text)
        root = ElementTree.fromstring(text)
        for _ in range(chance.choice((1, 1, 2))):
            parents = [e for e in root.iter() if len(e)]
            parent = chance.choice(parents)
            child = chance.choice(list(parent))
            kind = chance.randrange(10)
            having = [e for e in root.iter() if e.attrib]
            element = chance.choice(having)
            name = chance.choice(list(element.attrib))
            if kind < 5:
                words = element.attrib[name].split() or [""]
                place = chance.randrange(len(words))
                words[place] = self.number(words[place]).replace("\x00", "0x")
                element.attrib[name] = " ".join(words)
            elif kind == 5:
                del element.attrib[name]
            elif kind == 6:
                parent.remove(child)
            elif kind == 7:
                parent.append(child)
            elif kind == 8:
                child.tag = chance.choice(("link", "joint", "inertial", "mimic", "x", "axis"))
            else:
                others = [e.attrib[name] for e in having if name in e.attrib]
                others += ["x" * 3000, "a b", "é", "", "continuous", "floating", "planar", "fixed"]
                element.attrib[name] = chance.choice(others)
        return ElementTree.tostring(root, encoding="unicode")

    def table(self, text):
        """A CSV with cells, rows or columns changed."""
        chance = self.chance
        if chance.random() < 0.3:
            return self.text(text)
        rows = [line.split(",") for line in text.splitlines()]
        for _ in range(chance.choice((1, 1, 2, 4))):
            row = chance.randrange(len(rows))
            kind = chance.randrange(9)
            if kind < 4:
                place = chance.randrange(len(rows[row]))
                rows[row][place] = self.number(rows[row][place])
            elif kind == 4:
                rows.insert(row, list(rows[row]))
            elif kind == 5 and len(rows[row]) > 1:
                del rows[row][-1]
            elif kind == 6:
                column = chance.randrange(len(rows[0]))
                factor = self.factor()
                for other in rows[1:]:
                    with contextlib.suppress(ValueError, IndexError):
                        other[column] = repr(float(other[column]) * factor)
            elif kind == 7:
                chance.shuffle(rows[0])
            elif len(rows) > 2:
                del rows[row]
        return "\n".join(",".join(cells) for cells in rows) + "\n"

    def damaged(self, content):
        """Bytes with bits flipped, or cut."""
        chance, content = self.chance, bytearray(content)
        for _ in range(chance.choice((1, 1, 3, 20))):
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        return bytes(content[: chance.choice((None, None, chance.randrange(len(content))))])

    def parquet(self, columns):
        """A Parquet file of columns, of another type, with holes, or with other names."""
        import decimal

        import pyarrow as pa
        import pyarrow.parquet as parquet

        chance, columns = self.chance, dict(columns)
        name = chance.choice(list(columns))
        values = columns[name]
        whole = [round(1e9 * x) for x in values]
        changed = chance.choice(
            (
                lambda: pa.array([decimal.Decimal(f"{x:.6f}") for x in values]),
                lambda: pa.array(whole, pa.duration("ns")),
                lambda: pa.array(whole, pa.timestamp("ns", "Asia/Tokyo")),
                lambda: pa.array([None if chance.random() < 0.02 else x for x in values]),
                lambda: pa.array([str(x) for x in values]),
                lambda: pa.array([[x] for x in values]),
                lambda: pa.array(values, pa.float32()),
                lambda: pa.array([x * self.factor() for x in values]),
                lambda: pa.array([chance.choice((float("nan"), x)) for x in values]),
                lambda: pa.array(values).dictionary_encode(),
            )
        )()
        columns[name] = changed
        names = list(columns)
        if chance.random() < 0.2:
            names[chance.randrange(len(names))] = chance.choice([*names, *NAMES])
        table = pa.table(list(columns.values()), names=names)
        if chance.random() < 0.1:
            table = table.slice(0, chance.choice((0, 1, 5)))
        if chance.random() < 0.2:
            odd = chance.choice((b"{}", b"x", b'{"index_columns": ["gone"]}', b"\xff"))
            table = table.replace_schema_metadata({b"pandas": odd})
        made = io.BytesIO()
        parquet.write_table(table, made)
        return self.damaged(made.getvalue()) if chance.random() < 0.2 else made.getvalue()

    def messages(self, rows):
        """(time in ns, names, positions) of joint states, some of them wrong."""
        chance = self.chance
        rows = [(at, list(names), list(places)) for at, names, places in rows]
        for _ in range(chance.choice((1, 1, 3, 30))):
            at, names, places = rows[chance.randrange(len(rows))]
            kind = chance.randrange(7)
            if kind == 0:
                names.clear()
            elif kind == 1 and names:
                names[0] = chance.choice([*names, *NAMES])
            elif kind == 2 and places:
                places.pop()
            elif kind == 3 and places:
                places[0] *= self.factor()
            elif kind == 4 and places:
                places[0] = float("nan")
            elif kind == 5:
                rows[chance.randrange(len(rows))] = (at, names, places)
            else:
                places.clear()
        return rows

    def archive(self, content):
        """An npz with bits flipped, or with arrays of other shapes and values."""
        import numpy as np

        chance = self.chance
        if chance.random() < 0.5:
            return self.damaged(content)
        with np.load(io.BytesIO(content)) as file:
            entries = {name: file[name] for name in file.files}
        name = chance.choice(list(entries))
        array = entries[name]
        if name == "about":
            about = self.tree(json.loads(str(array)))
            entries[name] = np.array(chance.choice((json.dumps(about), "", "{}", "[]", "1")))
        else:
            entries[name] = chance.choice(
                (
                    lambda: array[:-1],
                    lambda: array[..., None],
                    lambda: array[::-1],
                    lambda: array * np.nan,
                    lambda: array * 1e300,
                    lambda: array.astype(str),
                    lambda: array.astype(complex),
                    lambda: np.zeros(0),
                    lambda: np.array(1.0),
                    lambda: np.concatenate([array, array]),
                    lambda: array + 1e9,
                    lambda: -array,
                )
            )()
        made = io.BytesIO()
        np.savez(made, **entries)
        return made.getvalue()
