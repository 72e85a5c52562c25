"""What leaves the grader: feedback that runs nothing and tells nothing hidden, tables of other systems, late work."""

import csv
import errno
import html.parser
import io
import json
import os
import re
import tempfile
import zipfile
from dataclasses import asdict

import numpy as np
import pytest
import yaml

import kit
from dualnav_lite import course
from dualnav_lite.config import UnusableInput
from dualnav_lite.exercises import stub
from grading.__main__ import _name_strangers as name_strangers
from grading.__main__ import main
from grading.feedback import REASONS, line_of, page, reason_text, reasons, zipped
from grading.grade import _result_or_ungraded, merge, write_tables
from grading.intake import Submission
from grading.late import late_shares
from grading.left_behind import left_behind
from grading.lesson import Outcome
from grading.lms import fill, gradescope_results, read_rows, totals
from grading.room import NOTEBOOKS
from grading.rubric import Late, load_rubric
from grading.said import said_by
from grading.store import to_json, write_whole
from grading.tables import COLUMNS, read_overrides, rows_of, to_csv
from grading.tasks import questions_of

EVIL = "<script>alert(1)</script>"


def a_result(student: str, **outcomes) -> dict:
    """A result file's content; what is not named got everything."""
    found = {name: Outcome(1.0, "passed", "", f"{name}:student") for name in load_rubric().points()} | outcomes
    return {
        "assignment": "course",
        "student_id": student,
        "folder": f"{student}_7_assignsubmission_file_",
        "submission_sha256": "0",
        "outcomes": {name: asdict(outcome) for name, outcome in found.items()},
        "prints": {},
        "library_prints": {},
        "tier": "A",
        "grader_version": "1",
    }


def rows_for(*results) -> list[dict]:
    return rows_of(list(results), load_rubric(), {}, {})


class Tags(html.parser.HTMLParser):
    """Every tag of a page and every attribute name."""

    def __init__(self, text: str):
        super().__init__()
        self.tags, self.attributes = set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


@pytest.mark.parametrize("language", ["en", "zh"])
def test_a_page_runs_nothing_whatever_stands_in_it(language):
    line = {"scenario": EVIL, "episodes": 20, "survived": 3, "low": 0.02, "high": 0.4, "threshold": 0.6}
    line |= {"decision": "failed", "collisions": 17, "timeouts": 0, "flat_batteries": 0, "errors": 0}
    result = a_result(
        EVIL,
        gae=Outcome(0.2, "partial", "terminated_has_no_future", "gae:student", {"right": 1, "asked": 5, "wrong": []}),
        goal=Outcome(0.0, "error", f"raised_{EVIL}", EVIL, {"right": 0, "asked": 1, "wrong": [EVIL]}),
        survival=Outcome(0.0, "failed", "survives_too_rarely", "policy:student", {"survival": [line]}),
    )
    text = page(result, rows_for(result), language, 0.1, 0.2).decode("utf-8")
    found = Tags(text)
    assert not found.tags & {"script", "img", "iframe", "object", "link", "form", "a", "svg"}
    assert not any(name.startswith("on") or name in ("href", "src") for name in found.attributes)
    assert "default-src &#x27;none&#x27;" in text
    assert reason_text("terminated_has_no_future", language).replace("`", "") in re.sub("</?code>", "", text)


def test_what_a_cell_said_is_kept_whatever_comes_out_of_the_sandbox():
    order = (("given", "import x"), ("solution", "goal"))
    error = {"output_type": "error", "ename": "\x1b[31mNameError", "evalue": "no\x07 name", "traceback": ["secret"]}
    printed = {"output_type": "stream", "text": ["one\n"] * 50}
    cells = [
        {"id": f"solution-{k}", "outputs": outputs} for k, outputs in ((1, [printed, error]), (0, [error]), (9, []))
    ]
    found = said_by(json.dumps({"cells": cells}).encode(), order)
    assert found == {"goal": "\n".join(["one"] * 12 + ["..."])}
    assert said_by(json.dumps({"cells": [cells[0] | {"outputs": [error]}]}).encode(), order) == {
        "goal": "NameError: no name"
    }
    for nothing in (
        b"",
        b"{",
        b"[" * 100_000,
        b'{"cells": 3}',
        b'{"cells": [{"id": "solution-1"}]}',
        b'{"cells": [3]}',
        json.dumps({"cells": [cells[0] | {"id": "solution-" + "9" * 5000}]}).encode(),  # no number of Python's
    ):
        assert said_by(nothing, order) == {}


def test_a_result_file_holds_no_tag_and_says_the_same():
    content = {"said": {"goal": EVIL + "\\ 张"}}
    assert b"<" not in to_json(content)
    assert json.loads(to_json(content)) == content


def test_a_mistake_that_follows_from_another_is_told_after_it():
    wrong = ["close_costs_the_square", "numbers_as_well"]
    detail = {"right": 2, "asked": 4, "wrong": wrong}
    result = a_result("7", safe=Outcome(0.4, "partial", wrong[0], "safe:student", detail))
    text = page(result, rows_for(result), "en", lessons={"safe": "07_rewards"}).decode("utf-8")
    first, then = (text.index(reason_text(code, "en")) for code in wrong)
    assert first < text.index("perhaps for the same reason") < then
    assert "<strong>07_rewards</strong>" in text
    assert "4 of 4" not in text


def test_every_reason_of_a_scorer_is_told_in_both_languages():
    hints = set()
    for lesson in load_rubric().lessons.values():
        for name in lesson.cells():
            for question in questions_of(name)(np.random.default_rng(0)):
                hints |= {question.hint, *question.also.values()}
    sources = "".join(path.read_text(encoding="utf-8") for path in REASONS.parent.glob("*.py"))
    known = set(re.findall(r'Rejected\("(\w+)"\)|Unreadable\("(\w+)"\)|"\\0(\w+)"', sources))
    codes = hints | {code for group in known for code in group if code}
    assert codes <= set(reasons())
    assert all(set(text) == {"en", "zh"} and all(text.values()) for text in reasons().values())
    assert "KeyError" in reason_text("raised_KeyError", "zh")


def test_the_feedback_zip_has_moodles_folders_and_the_same_bytes_each_time():
    pages = {"张 三_7_assignsubmission_file_": b"b", "A_8_assignsubmission_file_": b"a"}
    assert zipped(pages) == zipped(dict(reversed(pages.items())))
    with zipfile.ZipFile(io.BytesIO(zipped(pages))) as archive:
        assert archive.namelist() == [f"{name}/feedback.html" for name in sorted(pages)]


TEMPLATES = {
    "moodle": "Identifier,Full name,Grade,Maximum Grade\r\nParticipant 7,=1+1,,25\r\nParticipant 8,B,,25\r\n",
    "canvas": "Student,ID,SIS Login ID,HW (1)\nPoints Possible,,,25\nA,99,7,\nB,98,8,\n",
    "gradescope": "First Name,SID,Total Score\nA,7,\nB,8,\n",
    "nbgrader": "assignment,student_id,score\nc,7,\nc,8,\n",
}


@pytest.mark.parametrize("system", TEMPLATES)
def test_points_go_into_the_row_of_their_student_and_nothing_else_changes(system):
    points = totals(rows_for(a_result("7"), a_result("9")))
    template = b"\xef\xbb\xbf" + TEMPLATES[system].encode("utf-8")
    filled, missing = fill(system, template, points, "HW (1)" if system == "canvas" else "")
    assert filled.startswith(b"\xef\xbb\xbf")
    assert missing == ["9"]
    before, after = (list(csv.reader(io.StringIO(one.decode("utf-8-sig")))) for one in (template, filled))
    changed = [
        (r, c, new) for r, row in enumerate(after) for c, new in enumerate(row) if new not in (before[r][c], "'=1+1")
    ]
    assert [new for _, _, new in changed] == [f"{load_rubric().total:g}"]
    with pytest.raises(UnusableInput):
        fill(system, b"x,y\n1,2\n", points)


def test_a_number_of_another_column_is_not_taken_for_a_students_id():
    template = "Student,ID,SIS User ID,HW\nPoints Possible,,,25\nA,8,7,\nB,98,8,\nC,7,6,\nD,5,-d,\n"
    filled, missing = fill("canvas", template.encode(), {"7": "1", "8": "2", "'-d": "3"}, "HW")
    assert [row[3] for row in csv.reader(io.StringIO(filled.decode()))] == ["HW", "25", "1", "2", "", "3"]
    assert missing == []


A_RUN = {"fingerprint": "f", "rubric": load_rubric().sha256(), "tier": "A", "results": ["a.json"]}


def test_shards_are_merged_with_the_rubric_that_graded_them_alone(tmp_path):
    """With another one the points would be others, and nobody would see it."""
    write_whole(tmp_path / "1" / "results" / "a.json", to_json(a_result("7")))
    write_whole(tmp_path / "1" / "run.json", to_json(A_RUN))
    rubric = load_rubric()
    dearer = rubric.model_copy(update={"policy": rubric.policy.model_copy(update={"seconds": 9.0})})
    with pytest.raises(UnusableInput, match="--rubric"):
        merge([tmp_path / "1"], tmp_path / "out", dearer, {}, {})
    assert not (tmp_path / "out").exists()


def test_a_student_who_stands_in_two_shards_is_not_counted_twice(tmp_path):
    for k in (1, 2):
        result = a_result("7")
        write_whole(tmp_path / str(k) / "results" / "a.json", to_json(result))
        write_whole(tmp_path / str(k) / "run.json", to_json(A_RUN))
    assert len(merge([tmp_path / "1"], tmp_path / "out", load_rubric(), {}, {})) == len(load_rubric().points())
    with pytest.raises(UnusableInput, match="in two shards"):
        merge([tmp_path / "1", tmp_path / "2"], tmp_path / "out", load_rubric(), {}, {})


def test_a_correction_for_somebody_who_handed_nothing_in_is_named(capsys):
    name_strangers({"anna"}, {("anna", "gae"): (5.0, ""), ("ana", "gae"): (5.0, "")}, {"anna": 0.1})
    assert capsys.readouterr().err == "--overrides names 1 who handed nothing in: ana\n"


def test_a_short_line_of_overrides_is_refused(tmp_path):
    (tmp_path / "changes.csv").write_text("student_id,exercise,points,reason\n7,gae\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="line 2"):
        read_overrides(tmp_path / "changes.csv", load_rubric())


def test_a_line_without_its_student_is_refused(tmp_path):
    (tmp_path / "changes.csv").write_text("exercise,points,reason,student_id\ngae,5,sick\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="line 2: has no 'student_id'"):
        read_overrides(tmp_path / "changes.csv", load_rubric())
    (tmp_path / "times.csv").write_text("submitted,student_id\n2026-01-10T12:00\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="line 2: has no 'student_id'"):
        late_shares(tmp_path / "times.csv", "2026-01-10T12:00", Late())
    (tmp_path / "times.csv").write_text("student;submitted\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match="lacks the column"):
        late_shares(tmp_path / "times.csv", "2026-01-10T12:00", Late())


@pytest.mark.parametrize("change", ["semicolons", "another encoding", "emptied", "no points", "points in words"])
def test_grades_that_a_spreadsheet_spoilt_are_not_exported(change, tmp_path, capsys):
    table = to_csv(COLUMNS, rows_for(a_result("张"))).decode("utf-8")
    changed = {
        "semicolons": table.replace(",", ";").encode("utf-8"),
        "another encoding": table.encode("gbk"),
        "emptied": b"",
        "no points": table.replace('"gae","5"', '"gae",""').encode("utf-8"),
        "points in words": table.replace('"gae","5"', '"gae","4,5"').encode("utf-8"),
    }[change]
    (tmp_path / "grades.csv").write_bytes(changed)
    assert main(["export", "gradescope", "--grades", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["grades.csv"]


def test_a_status_that_a_teacher_wrote_into_the_grades_stands_for_itself(tmp_path):
    row = rows_for(a_result("7"))[0] | {"status": "Passed", "reason_code": ""}
    (tmp_path / "grades.csv").write_bytes(b"\xef\xbb\xbf" + to_csv(COLUMNS, [row]))
    assert line_of(read_rows(tmp_path)[0], "zh") == "Passed"


def test_an_ungraded_student_gets_no_zero_anywhere():
    nothing = a_result("7", gae=Outcome(0.0, "ungraded", "sandbox_failed"))
    rows = rows_for(nothing, a_result("8"))
    assert totals(rows) == {"8": f"{load_rubric().total:g}"}
    found = gradescope_results(rows, lambda row: row["status"])
    assert len(found["8"]["tests"]) == len(found["7"]["tests"]) + 1


def test_a_begun_day_of_delay_costs_a_day(tmp_path):
    times = tmp_path / "times.csv"
    lines = "a,2026-01-10T12:00\nb,2026-01-10T12:01\nc,2026-01-12T11:00\nd,2027-01-01T00:00\n"
    times.write_text("student_id,submitted\n" + lines, encoding="utf-8")
    found = late_shares(times, "2026-01-10T12:00", Late(per_day=0.1, most=0.5))
    assert found == pytest.approx({"a": 0.0, "b": 0.1, "c": 0.2, "d": 0.5})
    for due, more in (("soon", ""), ("2026-01-10T12:00", "a,2026-01-10T12:00\n"), ("", "")):
        times.write_text("student_id,submitted\n" + lines + more, encoding="utf-8")
        with pytest.raises(UnusableInput):
            late_shares(times, due, Late())


def test_what_should_stay_behind_is_found_in_a_student_version(tmp_path):
    course.write_lessons(tmp_path / "notebooks")
    assert left_behind(tmp_path, NOTEBOOKS, stub, b"k" * 64) == []
    worked = (NOTEBOOKS / "07_rewards.ipynb").read_text(encoding="utf-8")
    (tmp_path / "notebooks" / "07_rewards.ipynb").write_text(worked, encoding="utf-8")
    (tmp_path / "tests").mkdir()
    (tmp_path / "notes.txt").write_bytes(b"x" + b"k" * 64)
    (tmp_path / "notebooks" / "09_rollout_and_gae.ipynb").unlink()
    found = "\n".join(left_behind(tmp_path, NOTEBOOKS, stub, b"k" * 64))
    for word in ("tests is in it", "cell safe holds a solution", "notes.txt holds the key", "09_rollout_and_gae"):
        assert word in found


HOW_TO = ("docs/INSTRUCTORS.md", "grading/ci/github.yml", "grading/ci/gitlab.yml")


@pytest.mark.parametrize("file", HOW_TO)
def test_what_instructors_are_told_to_type_exists(file):
    text = (NOTEBOOKS.parent / file).read_text(encoding="utf-8")
    known = {name: {option for one in command.params for option in one.opts} for name, command in commands().items()}
    lines = re.findall(r"(-m grading|kit\.py) (\w+)([^\n#`]*)", text)
    assert len(lines) >= 2
    for program, verb, rest in lines:
        if program == "kit.py" and verb not in ("grade", "release"):
            assert verb in kit.COMMANDS
        else:
            options = set(re.findall(r"--[a-z-]+", rest))
            assert options - {"--check"} <= known[verb], (verb, rest)


def commands():
    from typer.main import get_command

    from grading.__main__ import app

    return get_command(app).commands


def test_the_files_for_ci_let_namespaces_be_made_and_grade_every_shard():
    github, gitlab = (yaml.safe_load((NOTEBOOKS.parent / name).read_text(encoding="utf-8")) for name in HOW_TO[1:])
    steps = " ".join(str(step.get("run")) for step in github["jobs"]["grade"]["steps"])
    assert "kernel.apparmor_restrict_unprivileged_userns=0" in steps
    assert "bubblewrap" in steps
    shards = github["jobs"]["grade"]["strategy"]["matrix"]["shard"]
    assert f"/{len(shards)} " in steps
    joined = " ".join(str(step.get("run")) for step in github["jobs"]["tables"]["steps"])
    assert all(f"shards/shard-{k}" in joined for k in shards)
    count = gitlab["grade"]["parallel"]
    assert all(f"shards/{k + 1}" in " ".join(gitlab["tables"]["script"]) for k in range(count))
    assert "kernel.apparmor_restrict_unprivileged_userns=0" in " ".join(gitlab["grade"]["script"])


def test_feedback_goes_into_the_folder_as_it_is_called_now(tmp_path):
    """Moodle's folders are called otherwise once the names of a blind marking are shown."""
    write_whole(tmp_path / "a.json", to_json(a_result("7")))
    now = Submission("7", "Anna_7_assignsubmission_file_")
    assert _result_or_ungraded(None, now, tmp_path / "a.json") == a_result("7") | {"folder": now.folder}


def test_a_full_disk_ends_in_one_line_and_leaves_no_half_file(tmp_path, monkeypatch, capsys):
    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "grades.csv").write_bytes(to_csv(COLUMNS, rows_for(a_result("7"))))
    monkeypatch.setattr(os, "fsync", full)
    assert main(["export", "gradescope", "--grades", str(tmp_path)]) == 2
    assert capsys.readouterr().err == "error: results.json: cannot be written: No space left on device\n"
    assert not [path for path in (tmp_path / "gradescope").rglob("*") if path.is_file()]


def test_what_the_machine_refuses_is_one_line(monkeypatch, capsys):
    def full(*given, **more):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "anna")

    monkeypatch.setattr(tempfile, "mkdtemp", full)
    assert main(["example"]) == 2
    assert capsys.readouterr().err == "error: this machine refuses: No space left on device\n"


def test_ctrl_c_says_that_the_same_command_goes_on(monkeypatch, capsys):
    def interrupted(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(tempfile, "mkdtemp", interrupted)
    assert main(["example"]) == 130
    assert "the same command goes on from here" in capsys.readouterr().err


def test_tables_and_feedback_are_written_whole_and_the_same_again(tmp_path):
    line = {"scenario": "navigation", "preference": 0.5, "episodes": 2, "safe_dist_m": 0.2, "energy_j_per_goal": None}
    detail = {"share_of_box": 0.1, "threshold": 0.2, "pareto": [line]}
    slow = a_result("7", hypervolume=Outcome(0.0, "failed", "dominates_too_little", "policy:student", detail))
    written = []
    for name in ("one", "two"):
        write_tables(tmp_path / name, [slow, a_result("8")], load_rubric(), {}, {}, "A")
        files = [path for path in sorted((tmp_path / name).rglob("*")) if path.is_file()]
        written.append({path.relative_to(tmp_path / name): path.read_bytes() for path in files})
    assert written[0] == written[1]
    assert len(written[0]) == 6
