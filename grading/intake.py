"""Submissions as they come from disk: plain folders or Moodle's bulk download, opened with care.

Nothing is followed, nothing special is opened, and what is read is bounded. A folder with something hostile in it is
rejected as a whole, with a reason code; the others are not touched by it. Of a class only hashes stay in memory: files
are read again, and compared with their hash, when their turn comes.
"""

import itertools
import os
import re
import stat
import unicodedata
from dataclasses import dataclass, field, replace
from pathlib import Path

from dualnav_lite.chunks import sha256
from dualnav_lite.config import UnusableInput

PACKED = "submission_"  # `kit.py submit` names its folder so, with the student's id behind
MOODLE = re.compile(r"(?P<name>.+)_(?P<id>\d+)_assignsubmission_(?P<kind>[a-z]+)_?", re.DOTALL)
MOST_FILE = 32 << 20
MOST_TOTAL = 128 << 20
MOST_FILES = 500
MOST_FOLDERS_DEEP = 6
MOST_NAME = 200
ARCHIVES = (".zip", ".tar", ".gz", ".xz", ".7z", ".rar")  # never opened; where nothing else is there, it is told

JOINERS = "\u200c\u200d"  # of letters, in Persian and Indic names


class Rejected(ValueError):
    """A submission that is not opened; its text is a reason code."""


class Changed(Exception):
    """What was handed in is no longer what it was when it was hashed."""


@dataclass
class Submission:
    """What was handed in.

    Attributes:
        student_id: Moodle's number, else the folder's name without the `submission_` of `kit.py submit`.
        folder: its name on disk, which Moodle's feedback takes back.
        files: path by file name, of the files that grading knows.
        rejected: reason code, empty where it can be graded.
        sha256: of the files' names and bytes.
        content: by file name, for a machine on which the paths lead nowhere.
    """

    student_id: str
    folder: str
    files: dict[str, str] = field(default_factory=dict)
    rejected: str = ""
    sha256: str = ""
    content: dict[str, bytes] | None = None

    def read(self) -> dict[str, bytes]:
        """Content by file name.

        Raises:
            Changed: it is not what was hashed.
        """
        if self.content is not None or not self.files:
            return self.content or {}
        try:
            content = {name: _read(path) for name, path in self.files.items()}
        except (OSError, Rejected):
            raise Changed from None
        if digest({name: sha256(one) for name, one in content.items()}) != self.sha256:
            raise Changed
        return content

    def packed(self) -> "Submission":
        """With its content, to be sent elsewhere; without where it has changed: then it stays ungraded there."""
        try:
            return replace(self, content=self.read())
        except Changed:
            return self


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


def _taken(folder: Path, wanted: frozenset[str]) -> tuple[dict[str, str], str]:
    """Path by file name of the wanted files, and their hash."""
    found: list[tuple[str, int]] = []
    _walk(str(folder), 0, found, [])
    files: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for path, _ in found:
        name = os.path.basename(path)
        if name in wanted:
            if name in files:
                raise Rejected("file_twice")
            files[name], hashes[name] = path, sha256(_read(path))
    if not files and any(path.lower().endswith(ARCHIVES) for path, _ in found):
        raise Rejected("still_packed")
    return files, digest(hashes)


def digest(hashes: dict[str, str]) -> str:
    """One hash of names and of the files' hashes."""
    lines = [f"{name}\0{one}" for name, one in sorted(hashes.items())]
    return sha256("\n".join(lines))


def take_in(folder: Path, wanted: frozenset[str]) -> list[Submission]:
    """Every submission in a folder, by student.

    Args:
        folder: one folder a student.
        wanted: names of the files that grading knows, such as `07_rewards.ipynb`.

    Raises:
        UnusableInput: no such folder, one that cannot be listed, nothing in it, or two folders of one student; names
            that a person cannot tell apart, since their letters are only composed in another way, are of one student.
    """
    if not folder.is_dir():
        raise UnusableInput(f"{folder}: no such folder")
    found, typed = [], []
    try:
        entries = list(os.scandir(folder))
    except OSError as error:
        raise UnusableInput(f"{folder}: cannot be read: {error.strerror}") from None
    for entry in entries:
        if entry.name.startswith("."):
            continue
        if not entry.is_dir(follow_symlinks=False) and not entry.is_symlink():
            continue  # a worksheet or a note beside the submissions
        moodle = MOODLE.fullmatch(entry.name)
        if moodle and moodle["kind"] != "file":
            typed.append(moodle["id"])
        else:
            found.append(_one(entry, wanted))
    handed_in = {one.student_id for one in found}
    found += [Submission(one, "", rejected="online_text", sha256=digest({})) for one in {*typed} - handed_in]
    found.sort(key=lambda one: one.student_id)
    if not found:
        raise UnusableInput(f"{folder}: holds no submission; each student has a folder of his own in it")
    known: dict[str, str] = {}
    for one in found:
        student = unicodedata.normalize("NFC", one.student_id)
        if student in known:
            both = f"{known[student]!a} and {one.folder!a}"
            raise UnusableInput(f"{folder}: {both} are folders of the same student; keep the one that counts")
        known[student] = one.folder
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
        safe = sha256(os.fsencode(entry.name))[:12]
        return Submission(f"unnamed-{safe}", "", rejected="folder_name", sha256=digest({}))
    try:
        if entry.is_symlink():
            raise Rejected("symbolic_link")
        submission.files, submission.sha256 = _taken(Path(entry.path), wanted)
    except Rejected as reason:
        submission.rejected, submission.sha256 = str(reason), digest({})
    except OSError:
        submission.rejected, submission.sha256 = "cannot_be_read", digest({})
    return submission
