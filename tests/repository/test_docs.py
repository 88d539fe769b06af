"""The documentation agrees with the code: public names, and nothing outside the repository.

`sphinx-build -W` builds the pages (in `.ci/run`); the rest is compared here.
"""

from __future__ import annotations

import importlib
import json
import re
import warnings
from pathlib import Path
from typing import Annotated, Union, get_args

import jsonschema
import numpy as np
import pytest
import yaml
from cli_cases import told
from pydantic import Field, TypeAdapter

import pinfric as pf
from pinfric.drives.catalog import Brake, CatalogFile
from pinfric.drives.limits import LIMITS
from pinfric.errors import PinfricError
from pinfric.formats import FORMATS, json_schema
from pinfric.model.bearings import KINDS, Bearing
from pinfric.model.entry import Entry, Forms
from pinfric.model.friction_terms import Stribeck
from pinfric.model.transmission import GEAR_KINDS
from pinfric.model.yamlfile import read_yaml
from pinfric.new_scene import write_new
from pinfric.sweeps.distributions import Steps

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "notebooks"


def test_every_public_name_is_on_the_page_of_names():
    page = (PAGES / "reference" / "python.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\.\. auto(?:function|class|exception):: pinfric\.(\w+)$", page, re.M)
    assert sorted([*shown, "__version__"]) == sorted(pf.__all__)
    assert "`pf.__version__`" in page


THEORY = sorted((PAGES / "theory").glob("*.md"))


@pytest.mark.parametrize("page", THEORY, ids=lambda page: page.stem)
def test_each_section_of_the_theory_says_who_computes_it_and_who_judges_it(page):
    sections = re.split(r"^## ", page.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    for section in sections if page.stem not in ("index", "literature") else ():
        assert section.count("{.judged}\n") == 1, section[:40]
        assert re.search(r"[Jj]udged\s[\w\s(),:]*by\s", section), section[:40]


@pytest.mark.parametrize("page", ["theory/*", "architecture", "evidence"])
def test_pages_name_functions_files_and_tests_that_exist(page):
    """Sphinx checks functions, in `.ci/run`, but not the rest."""
    text = "".join(file.read_text(encoding="utf-8") for file in PAGES.glob(f"{page}.md"))
    for module, name in re.findall(r"\{py:\w+\}`~?pinfric\.((?:\w+\.)*)(\w+)`", text):
        assert callable(getattr(importlib.import_module(f"pinfric.{module}".rstrip(".")), name))
    named = re.findall(r"[ `]((?:\w+/)*\w+\.py)(?:::(\w+))?[ `]", text)
    assert named
    for file, test in named:
        folders = [
            folder
            for folder in ("", "pinfric", "pinfric/dynamics", "tests/dynamics", "tests/judges")
            if (ROOT / folder / file).is_file()
        ]
        assert folders, file
        assert f"def {test}" in (ROOT / folders[0] / file).read_text(encoding="utf-8"), test


def test_the_pictures_of_the_architecture_are_those_of_the_code(monkeypatch):
    monkeypatch.syspath_prepend(PAGES)
    rooms = importlib.import_module("rooms")
    for name, picture in (("rooms", rooms.picture()), ("one_state", rooms.steps_picture())):
        assert picture == (PAGES / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
    for steps in rooms.STEPS.values():
        for function, module, _ in steps:
            assert callable(getattr(importlib.import_module(f"pinfric.{module}"), function))


def architecture_examples():
    text = (PAGES / "architecture.md").read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def test_a_limit_is_added_by_the_steps_of_the_architecture():
    example = next(x for x in architecture_examples() if "add_limit" in x)
    before = list(LIMITS)
    try:
        exec(compile(example, "architecture.md", "exec", dont_inherit=True), {"__name__": "added"})
        assert [limit.name for limit in LIMITS if limit not in before] == ["coupling torque"]
    finally:
        LIMITS[:] = before


def test_a_gear_is_added_by_the_steps_of_the_architecture(capsys):
    example = next(x for x in architecture_examples() if "gear_kind" in x)
    try:
        exec(compile(example, "architecture.md", "exec", dont_inherit=True), {"__name__": "added"})
        assert "lead" in json_schema("scene")["$defs"]["Worm"]["properties"]
    finally:
        GEAR_KINDS.pop("worm", None)
    torque = float(capsys.readouterr().out.strip("[]\n"))
    plain = pf.inverse_dynamics(pf.load_scene("pendulum"), [[0.5]], [[1.0]], [[0.0]])
    assert torque == pytest.approx(plain.effort_upper[0, 0] / 40 * np.tan(0.25) / np.tan(0.2))


def test_a_bearing_is_added_by_the_steps_of_the_architecture(capsys):
    example = next(x for x in architecture_examples() if "bearing_kind" in x)
    try:
        exec(compile(example, "architecture.md", "exec", dont_inherit=True), {"__name__": "added"})
        schema = json_schema("scene")["$defs"]
        assert schema["Bearing"]["discriminator"]["mapping"]["cone"] == "#/$defs/Cone"
        assert schema["Cone"]["properties"]["radius"]["description"] == (
            "mean radius of the faces (m)"
        )
    finally:
        KINDS.pop("cone", None)
    load = float(capsys.readouterr().out.strip("[]\n"))
    pin_load = pf.inverse_dynamics(pf.load_scene("pendulum"), [[0.5]], [[1.0]], [[0.0]]).normal_load
    assert load == pytest.approx(0.3 * pin_load[0, 0])  # radius 0.03 for 0.1, all of it radial


def test_no_sentence_refers_to_a_document_that_is_not_here():
    folders = ("pinfric", "tests", "robots", "notebooks", ".github", ".ci")
    files = [f for folder in folders for f in (ROOT / folder).rglob("*") if f.is_file()]
    files += [f for f in ROOT.iterdir() if f.is_file()]
    kinds = {".py", ".md", ".yaml", ".yml", ".ipynb", ".toml", ".cff", ".j2"}
    texts = {f: f.read_text(encoding="utf-8") for f in files if f.suffix in kinds}
    here = {f.name for f in files}
    assert len(texts) > 300
    for file, text in texts.items():
        absent = set(re.findall(r"(?<![\w-])[\w-]+\.md\b", text)) - here
        assert not absent, f"{file}: {absent}"
        cited = re.search(r"\bdesign(\.md| section| \d|,? §)|\b[Tt]he issue('s)?\b", text)
        assert cited is None or file.suffix == ".md" or file == Path(__file__), f"{file}: {cited}"


def entries(annotation, found):
    """Add all classes of entries that may stand where an annotation does."""
    if isinstance(annotation, type) and issubclass(annotation, Entry):
        kinds = KINDS.values() if annotation is Bearing else [annotation]
        for cls in set(kinds) - found:
            found.add(cls)
            for field in cls.model_fields.values():
                entries(Annotated[field.annotation, Field(), *field.metadata], found)
    for part in get_args(annotation):
        for form in part.forms.values() if isinstance(part, Forms) else [part]:
            entries(form, found)
    return found


ENTRIES = sorted(entries(Union[*FORMATS.values()], set()), key=lambda cls: cls.__name__)


def test_these_are_all_files_keys():
    assert {*KINDS.values()} | {CatalogFile, Brake, Stribeck, Steps} <= set(ENTRIES)
    assert len(ENTRIES) > 60


@pytest.mark.parametrize("cls", ENTRIES, ids=lambda cls: cls.__name__)
def test_every_key_of_every_file_says_what_it_is_with_unit_and_example(cls):
    fields = cls.model_fields
    assert all(field.description for field in fields.values())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # an example is of a usual size
        for field in fields.values():
            given = Annotated[field.annotation, Field(), *field.metadata]
            TypeAdapter(given).validate_python(*field.examples)
    for name, schema in cls.model_json_schema()["properties"].items():
        kinds = [schema, *schema.get("anyOf", []), *schema.get("prefixItems", [])]
        if any(kind.get("type") == "number" for kind in kinds):
            assert fields[name].json_schema_extra["unit"], name


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_has_a_page_made_from_its_classes(name, monkeypatch):
    monkeypatch.syspath_prepend(PAGES)
    assert f"reference/{name}\n" in (PAGES / "index.md").read_text(encoding="utf-8")
    lines = importlib.import_module("file_keys").FormatPage(name, {}).lines
    for cls in entries(FORMATS[name], set()):
        keys = {line.split(" | ")[0].removeprefix("| ") for line in lines}
        assert {f"`{key}`" for key in cls.model_fields} <= keys, cls


def test_the_reference_in_the_clone_is_what_the_code_says(monkeypatch):
    """After a change: python notebooks/make_reference.py."""
    monkeypatch.syspath_prepend(PAGES)
    made = importlib.import_module("make_reference").made()
    assert {page.stem for page in made} == {*FORMATS, "commands", "results"}
    slugs = {}
    for page, text in made.items():
        says = f"{page.name}: run `python notebooks/make_reference.py`"
        assert page.read_text(encoding="utf-8").split() == text.split(), says
        headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
        own = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
        assert len(own) == len(headings), page.name
        slugs[page.name] = own
    for page, text in made.items():
        for file, slug in re.findall(r"\]\(([\w.]*)#([^)]*)\)", text):
            assert slug in slugs[file or page.name], (page.name, slug)


BUNDLED = {
    "scene": [f for f in (ROOT / "robots").glob("*.yaml") if f.name.count(".") == 1],
    "waypoints": list((ROOT / "robots").glob("*.waypoints.yaml")),
    "sweep": list((ROOT / "robots").glob("*.sweep.yaml")),
    "catalog": [f for f in (ROOT / "pinfric" / "catalog").glob("*.yaml") if f.name.count(".") == 1],
    "table": list((ROOT / "pinfric" / "catalog").glob("*.columns.yaml")),
}


@pytest.mark.parametrize("name", FORMATS)
def test_schemas_accept_what_readers_accept(name):
    """Every bundled file, and the examples on the format's page; no misspelled key."""
    schema = json_schema(name)
    judge = jsonschema.Draft202012Validator(schema)
    judge.check_schema(schema)
    files = [read_yaml(file, PinfricError) for file in BUNDLED.get(name, [])]
    assert bool(files) == (name in BUNDLED)
    page = (PAGES / "reference" / f"{name}.md").read_text(encoding="utf-8")
    shown = map(yaml.safe_load, re.findall(r"^```yaml\n(.*?)^```", page, re.DOTALL | re.MULTILINE))
    for content in [*files, *filter(None, shown)]:
        judge.validate(content)
        assert not judge.is_valid({**content, "misspelt": 1})
    json.dumps(schema, allow_nan=False)


def test_schemas_know_every_kind_of_bearing_and_what_fits_none():
    judge = jsonschema.Draft202012Validator(json_schema("scene"))

    def scene(**friction):
        return {"pinfric": 1, "robot": {"urdf": "a.urdf"}, "friction": {"joint": friction}}

    mu = {"static": 0.2, "kinetic": 0.1}
    assert judge.is_valid(scene(bearing={"kind": "pin", "radius": 0.05}, mu=mu, viscous=0.1))
    assert judge.is_valid(scene(bearing={"kind": "seal"}, mu=mu, viscous={"coefficient": 1.0}))
    for wrong in ({"kind": "pin"}, {"kind": "pin", "radius": -1}, {"kind": "seal", "radius": 1}):
        assert not judge.is_valid(scene(bearing=wrong, mu=mu))
    assert not judge.is_valid(scene(viscus=0.1))
    assert not judge.is_valid(scene(viscous=-0.1))


def test_new_scenes_name_a_schema_that_accepts_them(tmp_path):
    for file in write_new(ROOT / "robots" / "pendulum.urdf", tmp_path):
        first = file.read_text(encoding="utf-8").splitlines()[0]
        named = re.fullmatch(r"# yaml-language-server: \$schema=(\w+\.schema\.json)", first)
        schema = json.loads((tmp_path / named[1]).read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator(schema).validate(read_yaml(file, PinfricError))


def test_the_command_prints_the_schema(capsys):
    assert json.loads(told(capsys, "schema", "sweep").out) == json_schema("sweep")
