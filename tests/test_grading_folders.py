import os
import tempfile
from pathlib import Path

import pytest

from grading.folders import PREFIX, own_prefix, sweep


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_only_what_nobody_living_made_is_swept(room):
    mine = Path(tempfile.mkdtemp(prefix=own_prefix()))
    born_later = own_prefix().rpartition("-")[0].rpartition("-")[0]
    dead, used_again = (
        room / f"{PREFIX}999999999-1-a",
        room / f"{born_later}-1-b",
    )  # a number that the kernel gave out again
    other = room / "something-else-here"
    for folder in (dead, used_again, other):
        (folder / "within").mkdir(parents=True)
    (room / f"{PREFIX}999999999-1-c").symlink_to(other)
    sweep()
    assert sorted(room.iterdir()) == sorted([mine, other])
    assert (other / "within").is_dir()


def test_a_forked_worker_has_folders_of_its_own():
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(write, own_prefix().encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(read, 100).decode() != own_prefix()
