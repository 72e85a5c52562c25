"""What a student reads: one page that runs nothing, says what to fix, and nothing of hidden inputs."""

import base64
import hashlib
import html
import io
import re
import zipfile
from functools import cache
from pathlib import Path

import yaml

REASONS = Path(__file__).resolve().parent / "reasons.yaml"
CODE = re.compile("`([^`]+)`")
STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "table{border-collapse:collapse;width:100%;margin:1rem 0}"
    "th,td{border-bottom:1px solid #ddd;padding:.45rem .6rem;text-align:left;vertical-align:top}"
    "th{font-weight:600}td.n,th.n{text-align:right}td.n,th.n,td span{white-space:nowrap}"
    ".passed{color:#0b6b3a}.partial{color:#8a5a00}.failed,.error,.timeout{color:#a3231d}.not_run,.manual{color:#555}"
    "code{background:#f5f5f5;padding:0 .2em}h3{font-size:1rem;margin-bottom:.3rem}"
    "pre{background:#f5f5f5;padding:.6rem;overflow-x:auto;white-space:pre-wrap}p.small{color:#555;font-size:.9rem}"
)
# Nothing is loaded, nothing runs; the one style is named by its hash.
POLICY = "default-src 'none'; style-src 'sha256-{}'; base-uri 'none'; form-action 'none'"
WORDS = {
    "en": {
        "title": "Feedback: {assignment}, {student}",
        "exercise": "Exercise",
        "points": "Points",
        "result": "Result",
        "todo": "What to look at",
        "passed": "passed",
        "partial": "partly right",
        "failed": "not right yet",
        "error": "error",
        "timeout": "too slow",
        "not_run": "nothing to grade",
        "manual": "decided by your teacher",
        "ungraded": "not graded yet",
        "right": "{right} of {asked} questions right",
        "learned": "at first {first:.0%} of what could be gained, at last {last:.0%}; needed {needed:.0%}, "
        "aim at {aim:.0%}",
        "perhaps": "perhaps for the same reason: ",
        "and": "; ",
        "comma": ", ",
        "colon": ": ",
        "stopped": "stopped after {asked} questions",
        "reference": "tried with the teacher's {names}, since yours did not pass",
        "drives": "Trained policy",
        "policy": "Your policy in rooms that it has never seen",
        "scenario": "Scenario",
        "survived": "Survived",
        "likely": "Likely range",
        "needed": "Needed",
        "aim": "Aim at",
        "ends": "How the others ended",
        "collisions": "{n} contacts",
        "timeouts": "{n} out of time",
        "flat_batteries": "{n} flat batteries",
        "errors": "{n} errors",
        "preference": "Preference",
        "safe": "Clearance [m]",
        "energy": "Energy a goal [J]",
        "box": "The points dominate {share:.0%} of the box; needed are {threshold:.0%}.",
        "late": "Late: {share:.0%} of the points are taken off.",
        "total": "Total",
        "cell": "What your own cell said when it was run",
        "foot": "Each question was asked of your function in a sandbox, with inputs that are the same for everybody "
        "and not shown. Printed text, plots and saved outputs count for nothing.",
    },
    "zh": {
        "title": "反馈：{assignment}，{student}",
        "exercise": "练习",
        "points": "得分",
        "result": "结果",
        "todo": "需要查看的地方",
        "passed": "通过",
        "partial": "部分正确",
        "failed": "还不对",
        "error": "出错",
        "timeout": "太慢",
        "not_run": "没有可评分的内容",
        "manual": "由老师评定",
        "ungraded": "尚未评分",
        "right": "{asked} 个问题答对 {right} 个",
        "learned": "可获得的改进中，开始时达到 {first:.0%}，最后 {last:.0%}；要求 {needed:.0%}，目标 {aim:.0%}",
        "perhaps": "可能是同一原因：",
        "and": "；",
        "comma": "、",
        "colon": "：",
        "stopped": "在第 {asked} 个问题后停止",
        "reference": "用老师的 {names} 测试，因为你的尚未通过",
        "drives": "训练好的策略",
        "policy": "你的策略在从未见过的房间里的表现",
        "scenario": "场景",
        "survived": "存活",
        "likely": "可能范围",
        "needed": "要求",
        "aim": "目标",
        "ends": "其余运行的结局",
        "collisions": "{n} 次接触",
        "timeouts": "{n} 次超时",
        "flat_batteries": "{n} 次电量耗尽",
        "errors": "{n} 次出错",
        "preference": "偏好",
        "safe": "间隙 [m]",
        "energy": "每个目标的能耗 [J]",
        "box": "这些点支配了区域的 {share:.0%}；要求 {threshold:.0%}。",
        "late": "迟交：扣除 {share:.0%} 的分数。",
        "total": "总分",
        "cell": "运行你的单元格时输出的信息",
        "foot": "每个问题都在沙箱中向你的函数提出，输入对所有人相同且不公开。打印的文字、图和保存的输出不计分。",
    },
}


@cache
def reasons() -> dict[str, dict[str, str]]:
    """Text by reason code and language."""
    return yaml.safe_load(REASONS.read_text(encoding="utf-8"))


def reason_text(code: str, language: str) -> str:
    """What a reason code means; one that is unknown, as in an override, stands for itself."""
    kind, name = (code, "") if code in reasons() else (code.partition("_")[0], code.partition("_")[2])
    text = reasons().get(kind)
    return text[language].format(name=name) if text else code


def _table(head: list[str], rows: list[list[str]], numbers: tuple[int, ...] = ()) -> str:
    """A table of cells that are escaped already."""
    kinds = [' class="n"' if k in numbers else "" for k in range(len(head))]
    lines = ["<tr>" + "".join(f"<th{kind}>{cell}</th>" for kind, cell in zip(kinds, head, strict=True)) + "</tr>"]
    for row in rows:
        lines.append(
            "<tr>" + "".join(f"<td{kind}>{cell}</td>" for kind, cell in zip(kinds, row, strict=True)) + "</tr>"
        )
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _marked(text: str) -> str:
    """A text of ours, escaped, with code between backticks."""
    return CODE.sub(r"<code>\1</code>", html.escape(text))


def _todo(row: dict, outcome: dict, words: dict, language: str) -> str:
    """What stands beside an exercise: the first mistake, which the plainest question told, then what else failed."""
    lines = [reason_text(row["reason_code"], language)] if row["reason_code"] else []
    detail = outcome["detail"]
    if row["status"] != "manual":
        wrong = [reason_text(code, language) for code in detail.get("wrong", []) if code != row["reason_code"]]
        if wrong:
            lines.append(words["perhaps"] + words["and"].join(wrong))
    if "right" in detail and "survival" not in detail and row["status"] != "passed":
        stopped = row["status"] in ("error", "timeout")
        lines.append(words["stopped" if stopped else "right"].format(**detail))
    if "learning" in detail:
        lines.append(words["learned"].format(**detail["learning"]))
    lent = [part.partition(":")[0] for part in outcome["source"].split("+") if part.endswith(":reference")]
    if lent:
        lines.append(words["reference"].format(names=words["comma"].join(f"`{name}`" for name in lent)))
    return "<br>".join(_marked(line) for line in lines)


def _drives(result: dict, words: dict, margin: float) -> str:
    """Tables of the policy task, where there was one."""
    survival = result["outcomes"].get("survival", {}).get("detail", {}).get("survival")
    if not survival:
        return ""
    rows = []
    for line in survival:
        kinds = ("collisions", "timeouts", "flat_batteries", "errors")
        ends = words["comma"].join(words[kind].format(n=line[kind]) for kind in kinds if line[kind])
        likely = f"{line['low']:.0%} – {line['high']:.0%}"
        needed, aim = f"{line['threshold']:.0%}", f"{min(1.0, line['threshold'] + margin):.0%}"
        count = f"{line['survived']} / {line['episodes']}"
        verdict = "passed" if line["decision"] == "passed" else "failed"
        shown = f'<span class="{verdict}">{words[verdict]}</span>'
        rows.append([html.escape(line["scenario"]), count, likely, needed, aim, shown, ends])
    head = [words[name] for name in ("scenario", "survived", "likely", "needed", "aim", "result", "ends")]
    parts = [f"<h2>{words['policy']}</h2>", _table(head, rows, (1, 2, 3, 4))]
    detail = result["outcomes"].get("hypervolume", {}).get("detail", {})
    if "pareto" in detail:
        rows = []
        for line in detail["pareto"]:
            energy = "–" if line["energy_j_per_goal"] is None else f"{line['energy_j_per_goal']:.0f}"
            rows.append([f"{line['preference']:g}", f"{line['safe_dist_m']:.2f}", energy])
        parts.append(_table([words["preference"], words["safe"], words["energy"]], rows, (0, 1, 2)))
        box = words["box"].format(share=detail["share_of_box"], threshold=detail["threshold"])
        parts.append(f"<p>{box}</p>")
    return "\n".join(parts)


def page(
    result: dict,
    rows: list[dict],
    language: str,
    margin: float = 0.0,
    late: float = 0.0,
    lessons: dict[str, str] | None = None,
) -> bytes:
    """The page of one student.

    Args:
        result: content of the result file.
        rows: of `grades.csv` of this student.
        margin: of the policy task, which students are told.
        late: share of the points that delay costs.
        lessons: notebook by exercise, where there is one.
    """
    words = WORDS[language]
    lines, total, most, place = [], 0.0, 0.0, ""
    for row in rows:
        here = (lessons or {}).get(row["exercise"], words["drives"])
        if lessons and here != place:
            place = here
            lines.append([f"<strong>{html.escape(here)}</strong>", "", "", ""])
        outcome = result["outcomes"][row["exercise"]]
        status = f'<span class="{row["status"]}">{words[row["status"]]}</span>'
        points = f"{row['points'] or '–'} / {row['max_points']}"
        name = f"<code>{html.escape(row['exercise'])}</code>"
        lines.append([name, points, status, _todo(row, outcome, words, language)])
        total, most = total + float(row["points"] or 0.0), most + float(row["max_points"])
    lines.append([f"<strong>{words['total']}</strong>", f"<strong>{total:g} / {most:g}</strong>", "", ""])
    head = [words[name] for name in ("exercise", "points", "result", "todo")]
    said = [
        f"<h3><code>{html.escape(name)}</code></h3><pre>{html.escape(text)}</pre>"
        for name, text in result.get("said", {}).items()
        if name in result["outcomes"]
    ]
    title = html.escape(words["title"].format(assignment=result["assignment"], student=result["student_id"]))
    digest = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
    parts = [
        f'<!doctype html>\n<html lang="{language}"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(POLICY.format(digest))}">',
        f"<title>{title}</title><style>{STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        _table(head, lines, (1,)),
        f"<p>{words['late'].format(share=late)}</p>" if late else "",
        _drives(result, words, margin),
        f"<h2>{words['cell']}</h2>" if said else "",
        *said,
        f'<p class="small">{words["foot"]}</p>',
        "</body></html>",
    ]
    return ("\n".join(part for part in parts if part) + "\n").encode("utf-8")


def line_of(row: dict, language: str) -> str:
    """One line about an exercise, for systems that take text alone."""
    words = WORDS[language]
    reason = words["colon"] + reason_text(row["reason_code"], language) if row["reason_code"] else ""
    return words.get(row["status"], row["status"]) + reason


def zipped(pages: dict[str, bytes]) -> bytes:
    """Moodle's feedback zip: a folder a submission, named as in the bulk download; the same bytes each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for folder, content in sorted(pages.items()):
            archive.writestr(zipfile.ZipInfo(f"{folder}/feedback.html", (1980, 1, 1, 0, 0, 0)), content)
    return buffer.getvalue()
