"""All files or none, and the folder that was there before."""

import fcntl
import os
import stat
import subprocess
import sys
import threading

import pytest

from pinfric.errors import PinfricError, PinfricWarning
from pinfric.model.files import RECORD, check_writable, file_hash, write_file, write_folder
from pinfric.model.inputs import running_command


def texts(folder):
    return {p.name: p.read_text() for p in folder.iterdir() if p.is_file()}


def writers(**contents):
    return {name: lambda path, text=text: path.write_text(text) for name, text in contents.items()}


def test_folder_where_a_file_should_go_is_refused_before_anything_is_written(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "a").write_text("old")
    called = []
    with pytest.raises(PinfricError, match="it contains a folder b, where a file of that name"):
        write_folder(tmp_path, {"a": called.append, "b": called.append})
    assert called == []
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]
    assert texts(tmp_path) == {"a": "old"}


def test_failure_half_way_brings_the_old_files_back(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("old")
    (tmp_path / "kept").write_text("kept")
    replace, count = os.replace, []

    def third_fails(source, target):
        count.append(target)
        if len(count) == 3:
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    monkeypatch.setattr(os, "replace", third_fails)
    with pytest.raises(PinfricError, match="cannot be written: Permission denied"):
        write_folder(tmp_path, writers(a="new", b="new", c="new"))
    assert texts(tmp_path) == {"a": "old", "kept": "kept"}
    assert len(list(tmp_path.iterdir())) == 2


def test_old_files_are_kept_also_where_links_cannot_be_made(tmp_path, monkeypatch):
    def no_links(*_, **__):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", no_links)
    test_failure_half_way_brings_the_old_files_back(tmp_path, monkeypatch)


def test_new_files_replace_old_ones(tmp_path):
    (tmp_path / "a").write_text("old")
    write_folder(tmp_path, writers(a="new", b="new"))
    assert texts(tmp_path) == {"a": "new", "b": "new"}
    assert len(list(tmp_path.iterdir())) == 2


def test_name_no_file_system_takes(tmp_path):
    with pytest.raises(PinfricError, match="File name too long; name a folder") as caught:
        check_writable(tmp_path / ("x" * 5000))
    assert len(str(caught.value)) < 300


def test_a_folder_in_place_of_a_file_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PinfricError, match=f"{tmp_path}: is a folder; name the file"):
        write_file(".", lambda path: path.write_text("new"))


def test_a_folder_named_like_a_file_is_not_made(tmp_path):
    with pytest.raises(PinfricError, match=r"z1\.yaml: is named like a file; name a folder"):
        write_folder(tmp_path / "z1.yaml", writers(a="new"))
    assert not list(tmp_path.iterdir())
    (tmp_path / "z1.yaml").mkdir()
    for there in ("z1.yaml", "run.v2"):  # it was made on purpose; no ending of a file
        assert write_folder(tmp_path / there, writers(a="new"))


def test_what_killed_runs_left_is_removed_and_what_others_write_stays(tmp_path):
    (tmp_path / ".unfinished-dead").mkdir()
    (tmp_path / ".unfinished-dead" / "half.csv").write_text("1,2")

    def inner(path):
        """Another run begins and ends while this one is writing."""
        write_folder(tmp_path, {"b.txt": lambda other: other.write_text("b")})
        write_file(path, lambda whole: whole.write_text("a"))  # and within the folder it writes in

    write_folder(tmp_path, {"a.txt": inner})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "b.txt"]


@pytest.mark.parametrize("moved", [0, 1, 2])
def test_results_of_a_run_killed_between_two_files_are_known(tmp_path, monkeypatch, moved):
    """The next run replaces them; it took the new one for a stranger's."""
    left, replace = iter(range(moved)), os.replace

    def until_killed(*arguments):
        if next(left, None) is None:
            raise KeyboardInterrupt
        replace(*arguments)

    with running_command():
        write_folder(tmp_path, writers(a="first", b="first"))
        monkeypatch.setattr(os, "replace", until_killed)
        with pytest.raises(KeyboardInterrupt):
            write_folder(tmp_path, writers(a="second", b="second"))
        monkeypatch.undo()
        write_folder(tmp_path, writers(a="third", b="third"))
        assert {text for name, text in texts(tmp_path).items() if name in "ab"} == {"third"}
        (tmp_path / "a").write_text("changed")
        with pytest.raises(PinfricError, match="was changed since pinfric wrote it"):
            write_folder(tmp_path, writers(a="fourth"))
        (tmp_path / RECORD).write_text('{"a": 5}')
        with pytest.raises(PinfricError, match="is there already"):
            write_folder(tmp_path, writers(a="fourth"))


def test_a_device_stays_a_device(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_file(tmp_path / "pipe", lambda path: path.write_text("through"))
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_the_hash_of_a_folder_is_of_the_names_and_contents_of_its_data_files(tmp_path):
    (tmp_path / "a.csv").write_text("1")
    (tmp_path / "b.yaml").write_text("2")
    first = file_hash(tmp_path)
    (tmp_path / "c.txt").write_text("no data")
    assert file_hash(tmp_path) == first
    (tmp_path / "a.csv").write_text("3")
    second = file_hash(tmp_path)
    (tmp_path / "b.yaml").rename(tmp_path / "d.yaml")
    assert len({first, second, file_hash(tmp_path)}) == 3


def test_text_with_a_name_that_is_not_utf_8_is_refused(tmp_path):
    with pytest.raises(PinfricError, match=r"a file's name in it is not in UTF-8 \('.*\\udcff'\)"):
        write_folder(tmp_path / "a", {"x": lambda path: path.write_text("a\udcff", "utf-8")})
    assert list(tmp_path.iterdir()) == []


def test_result_does_not_replace_a_link_that_leads_nowhere(tmp_path):
    (tmp_path / "page.html").symlink_to("gone/page.html")
    with pytest.raises(PinfricError, match=r"is a link to gone/page\.html, where nothing is"):
        write_file(tmp_path / "page.html", "text")
    assert (tmp_path / "page.html").is_symlink()


def test_nothing_is_left_where_a_process_may_open_few_files(tmp_path):
    """Each number of files, up to the first with which all is written."""
    script = f"""
import os, resource, sys
from pinfric.errors import PinfricError, PinfricWarning
from pinfric.model.files import write_folder
for most in range(3, 30):
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, 30))
    try:
        write_folder({str(tmp_path)!r}, {{"a": "text"}})
        break
    except PinfricError:
        resource.setrlimit(resource.RLIMIT_NOFILE, (30, 30))
        assert os.listdir({str(tmp_path)!r}) == [], most
print(most)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert 6 < int(done.stdout) < 29, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_locked_folder_says_at_once_who_locks_it(tmp_path):
    held = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    timer = threading.Timer(0.3, os.close, [held])
    timer.start()
    with pytest.warns(PinfricWarning, match=f"waiting for process {os.getpid()}, which holds"):
        write_file(tmp_path / "a", "text")
    assert (tmp_path / "a").read_text() == "text"
