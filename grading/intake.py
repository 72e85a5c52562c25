"""Submissions as they come from disk: plain folders or Moodle's bulk download, opened with care.

Nothing is followed, nothing special is opened, and what is read is bounded. A folder with something hostile in it is
rejected as a whole, with a reason code; the others are not touched by it.
"""

import hashlib
import itertools
import os
import re
import stat
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path

from dualnav_lite.config import UnusableInput

PACKED = "submission_"  # `kit.py submit` names its folder so, with the student's id behind
MOODLE = re.compile(r"(?P<name>.+)_(?P<id>\d+)_assignsubmission_file_?", re.DOTALL)
MOST_FILE = 32 << 20
MOST_TOTAL = 128 << 20
MOST_FILES = 500
MOST_FOLDERS_DEEP = 6
MOST_NAME = 200
ARCHIVES = (".zip", ".tar", ".gz", ".xz", ".7z", ".rar")  # never opened; where nothing else is there, it is told

JOINERS = "\u200c\u200d"  # of letters, in Persian and Indic names


class Rejected(ValueError):
    """A submission that is not opened; its text is a reason code."""


@dataclass
class Submission:
    """What was handed in.

    Attributes:
        student_id: Moodle's number, else the folder's name without the `submission_` of `kit.py submit`.
        folder: its name on disk, which Moodle's feedback takes back.
        files: content by file name, of the files that grading knows.
        rejected: reason code, empty where it can be graded.
        sha256: of the files' names and bytes.
    """

    student_id: str
    folder: str
    files: dict[str, bytes] = field(default_factory=dict)
    rejected: str = ""
    sha256: str = ""


def is_plain(name: str) -> bool:
    """Whether a name is printable text in any script: no control, no half character, no direction override."""
    return 0 < len(name) <= MOST_NAME and not any(
        unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") and c not in JOINERS for c in name
    )


def _walk(folder: str, depth: int, found: list[tuple[str, int]], folders: list[str]) -> None:
    """Every file below a folder as (path, bytes); `Rejected` at the first thing that is not a plain file or folder."""
    folders.append(folder)
    if depth > MOST_FOLDERS_DEEP:
        raise Rejected("folders_too_deep")
    if len(folders) > MOST_FILES:
        raise Rejected("too_many_files")
    with os.scandir(folder) as entries:
        some = list(itertools.islice(entries, MOST_FILES + 1))
        for entry in sorted(some, key=lambda one: os.fsencode(one.name)):
            if not is_plain(entry.name):
                raise Rejected("file_name")
            status = entry.stat(follow_symlinks=False)
            if stat.S_ISDIR(status.st_mode):
                _walk(entry.path, depth + 1, found, folders)
            elif stat.S_ISLNK(status.st_mode):
                raise Rejected("symbolic_link")
            elif not stat.S_ISREG(status.st_mode):
                raise Rejected("special_file")
            else:
                if status.st_size > MOST_FILE:
                    raise Rejected("file_too_large")
                found.append((entry.path, status.st_size))
                if len(found) > MOST_FILES or sum(size for _, size in found) > MOST_TOTAL:
                    raise Rejected("too_many_files")


def _read(path: str) -> bytes:
    """A plain file, opened so that neither a link nor a pipe put in its place since can fool or stop us."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise Rejected("special_file")
        content = file.read(MOST_FILE + 1)
    if len(content) > MOST_FILE:
        raise Rejected("file_too_large")
    return content


def _taken(folder: Path, wanted: frozenset[str]) -> dict[str, bytes]:
    found: list[tuple[str, int]] = []
    _walk(str(folder), 0, found, [])
    files: dict[str, bytes] = {}
    for path, _ in found:
        name = os.path.basename(path)
        if name in wanted:
            if name in files:
                raise Rejected("file_twice")
            files[name] = _read(path)
    if not files and any(path.lower().endswith(ARCHIVES) for path, _ in found):
        raise Rejected("still_packed")
    return files


def digest(files: dict[str, bytes]) -> str:
    """One hash of names and bytes."""
    lines = [f"{name}\0{hashlib.sha256(content).hexdigest()}" for name, content in sorted(files.items())]
    return hashlib.sha256("\n".join(lines).encode("utf-8")).hexdigest()


def take_in(folder: Path, wanted: frozenset[str]) -> list[Submission]:
    """Every submission in a folder, by student.

    Args:
        folder: one folder a student.
        wanted: names of the files that grading knows, such as `07_rewards.ipynb`.

    Raises:
        UnusableInput: no such folder, nothing in it, or two folders of one student.
    """
    if not folder.is_dir():
        raise UnusableInput(f"{folder}: no such folder")
    found = []
    for entry in os.scandir(folder):
        if entry.name.startswith("."):
            continue
        if not entry.is_dir(follow_symlinks=False) and not entry.is_symlink():
            continue  # a worksheet or a note beside the submissions
        found.append(_one(entry, wanted))
    found.sort(key=lambda one: one.student_id)
    if not found:
        raise UnusableInput(f"{folder}: holds no submission; each student has a folder of his own in it")
    for one, other in itertools.pairwise(found):
        if one.student_id == other.student_id:
            raise UnusableInput(f"{folder}: two folders are of the same student; keep the one that counts")
    return found


def _one(entry, wanted: frozenset[str]) -> Submission:
    """One folder as a submission."""
    moodle = MOODLE.fullmatch(entry.name)
    if moodle and not is_plain(entry.name):
        return Submission(moodle["id"], "", rejected="folder_name", sha256=digest({}))
    if moodle:
        submission = Submission(moodle["id"], entry.name)
    elif is_plain(entry.name):
        student = entry.name.removeprefix(PACKED)
        submission = Submission(entry.name if student in ("", ".", "..") else student, entry.name)
    else:
        safe = hashlib.sha256(os.fsencode(entry.name)).hexdigest()[:12]
        return Submission(f"unnamed-{safe}", "", rejected="folder_name", sha256=digest({}))
    try:
        if entry.is_symlink():
            raise Rejected("symbolic_link")
        submission.files = _taken(Path(entry.path), wanted)
    except Rejected as reason:
        submission.rejected, submission.files = str(reason), {}
    except OSError:
        submission.rejected, submission.files = "cannot_be_read", {}
    submission.sha256 = digest(submission.files)
    return submission
