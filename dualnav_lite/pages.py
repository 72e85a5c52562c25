"""The report of a stress test: one page of blocks, written as Markdown and as HTML, in English and in Chinese."""
# ruff: noqa: E501, RUF001  (paragraphs; Chinese punctuation is meant)

import html
import platform
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from dualnav_lite import __version__
from dualnav_lite.config import write_atomic
from dualnav_lite.figures.captions import CAPTIONS
from dualnav_lite.judge import BLIND, CEILING, FLOOR, PUBLISHED, is_kind
from dualnav_lite.report import (
    HEADER,
    NUMBERS,
    PAIRED_HEADER,
    markdown,
    paired_cells,
    percent,
    stands,
    survival_cells,
    titles,
)

FIGURES = ("survival", "runs", "trajectories", "reward_terms")
# fmt: off
TEXTS = {
    "en": {
        "title": "Stress test",
        "made": "Made by `{command}`, kit {kit}, {machine}. Seeds {seeds}; every arm runs the same.",
        "summary": "Of {n} rows with a rate of the article `{arm}` beats {beaten} with certainty (the exact 95 % lower bound lies "
                   "above); {open} stay open (the interval holds the article's rate), {missed} are missed.",
        "failed": "Failed", "who": "Who survives", "against": "Against the article", "pairs": "On the same seeds",
        "three": "Three hours, no contact allowed", "published": "Published arms, joined by seed", "figures": "Figures",
        "reading": "Survived: goal reached in time, no contact, charge left. Interval: Wilson, 95 %. `article`: the rate that "
                   "the article claims for its own policy. Floor: `{floor}`. Best blind arm: the best of those that know the "
                   "goal's bearing and the clock alone ({blind}). `{ceiling}` knows where everything is and how fast it moves. "
                   "Clearance: mean over runs of the least distance of the hull from anything solid; energy: mean of a run. "
                   "`ppo` drives with the guide's point on an A* path; of `ppo_filter` every command is also checked by the "
                   "safety filter.",
        "joined": "Floor, blind arms and ceiling are published rows, of {n} of these seeds.",
        "alone": "No published row has one of these seeds, so floor, blind arms and ceiling are missing here.",
        "verdict": "{title}, `{arm}`: {survived} of {episodes}, {low} to {high} (exact, 95 %); the article's {claim} {word}.",
        "beaten": "is beaten", "missed": "is missed", "open": "is not beaten with certainty",
        "met": "is met by these runs, which a longer series may end",
        "strict": "`{arm}`: {survived} of {episodes} without any contact", "contacts": ", {n} contacts in all",
        "test": "Exact McNemar test; difference of rates in points with Newcombe's interval.",
        "ablations": "Ablations", "trained": "Policies that were trained alike but for one part, once each and for less than `ppo`, so "
                     "they are held against `ablation_default` alone.",
    },
    "zh": {
        "title": "压力测试",
        "made": "由 `{command}` 生成，套件版本 {kit}，{machine}。种子 {seeds}；各方案使用相同种子。",
        "summary": "表中有文章数值的 {n} 行里，`{arm}` 有把握地超过 {beaten} 行（精确 95 % 下限高于文章数值）；{open} 行尚无定论（区间"
                   "包含文章数值），{missed} 行未达到。",
        "failed": "失败", "who": "存活情况", "against": "与文章对照", "pairs": "相同种子上的比较",
        "three": "三小时，不允许任何接触", "published": "已发布的其他方案（按种子合并）", "figures": "图",
        "reading": "存活：按时到达目标、无接触、电量未耗尽。区间：Wilson，95 %。“文章”：文章为其自身策略声称的存活率。静止基线：`{floor}`。"
                   "最好的盲驾方案：只知道目标方位与时间的方案（{blind}）中最好的一个。`{ceiling}`（上限）知道一切物体的位置与速度。间隙：各次运行"
                   "中机身与任何实体最小距离的均值；能耗：单次运行均值。`ppo` 以 A* 路径上的引导点行驶；`ppo_filter` 的每个指令还要经过安全"
                   "滤波器检查。",
        "joined": "静止基线、盲驾方案与上限取自已发布的数据行，含这些种子中的 {n} 个。",
        "alone": "已发布的数据行中没有这些种子，因此这里缺少静止基线、盲驾方案与上限。",
        "verdict": "{title}，`{arm}`：{episodes} 次中存活 {survived} 次，{low} 至 {high}（精确，95 %）；文章的 {claim} {word}。",
        "beaten": "被超过", "missed": "未达到", "open": "尚不能有把握地说被超过", "met": "在这些运行中已达到，但更多次运行可能改变结论",
        "strict": "`{arm}`：{episodes} 次中 {survived} 次无任何接触", "contacts": "，共 {n} 次接触",
        "test": "McNemar 精确检验；存活率之差（百分点）与 Newcombe 区间。",
        "ablations": "消融实验", "trained": "除一处外训练方式相同的策略，每种只训练一次，训练量少于 `ppo`，因此只与 `ablation_default` 对照。",
    },
}
HEADS = {
    "scenario": "场景", "arm": "方案", "survived": "存活", "rate": "存活率", "95 %": "95 % 区间", "article": "文章", "floor": "静止基线",
    "best blind arm": "最好的盲驾方案", "ceiling": "上限", "clearance": "间隙", "energy": "能耗", "only a": "仅 a", "only b": "仅 b",
    "p (McNemar)": "p（McNemar）",
}
# fmt: on
STYLE = """
:root{color-scheme:light dark;--ink:#1c1e22;--quiet:#5c6066;--page:#fff;--line:#d9d9d4;--band:#f5f5f2}
@media(prefers-color-scheme:dark){:root{--ink:#e8e8e4;--quiet:#a8acb2;--page:#17181b;--line:#3a3d42;--band:#202226}}
body{margin:2rem auto;max-width:84rem;padding:0 1rem;background:var(--page);color:var(--ink);
font:16px/1.5 system-ui,"Noto Sans","Noto Sans CJK SC","Microsoft YaHei",sans-serif}
h1{font-size:1.7rem}h2{font-size:1.2rem;margin-top:2.2rem}p,li{max-width:62rem}
code{font-size:.92em;background:var(--band);padding:0 .25em;border-radius:3px;overflow-wrap:anywhere}
div.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{padding:.25rem .6rem;text-align:left;border-bottom:1px solid var(--line);white-space:nowrap}
th{border-bottom:2px solid var(--quiet)}td.n,th.n{text-align:right}tr:nth-child(even) td{background:var(--band)}
figure{margin:1.5rem 0}figure img{max-width:100%;background:#fff;border-radius:6px;padding:.5rem;box-sizing:border-box}
figcaption{color:var(--quiet);font-size:.9rem;max-width:62rem}
"""
Block = tuple


def blocks(
    tables: Mapping[str, pd.DataFrame],
    command: str,
    failed: Sequence[tuple[str, str]],
    language: str = "en",
    drawn: Sequence[str] = (),
) -> list[Block]:
    """The page, a block a heading, paragraph, list, table or figure; `drawn` names figures with their files."""
    say, names = TEXTS[language], titles(language)
    table, strict = tables["survival"], tables["survival_strict"]
    measured, others = table[table.source != PUBLISHED], table[table.source == PUBLISHED]
    seeds = f"{measured.seed_first.min()} - {measured.seed_last.max()}"
    machine = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    page: list[Block] = [("h1", say["title"])]
    page += [("p", line) for line in _summary(measured, say)]
    page.append(("p", say["made"].format(command=command, kit=__version__, machine=machine, seeds=seeds)))
    if failed:
        page += [("h2", say["failed"]), ("list", [f"`{what}`: {reason}" for what, reason in failed])]
    page += [("h2", say["who"]), ("table", HEADER, survival_cells(table, None, language))]
    page.append(("p", say["reading"].format(floor=FLOOR, ceiling=CEILING, blind=", ".join(BLIND))))
    beside = others[[is_kind(arm, (*BLIND, CEILING, FLOOR)) for arm in others.arm]]
    if len(beside):
        counts = sorted(set(beside.episodes))
        page.append(("p", say["joined"].format(n=" - ".join(str(n) for n in dict.fromkeys((counts[0], counts[-1]))))))
    elif not any(is_kind(arm, (*BLIND, CEILING, FLOOR)) for arm in table.arm):
        page.append(("p", say["alone"]))
    page += _figures(("survival",), drawn, language)
    page += [("h2", say["against"]), ("list", _verdicts(measured, say, names))]
    if len(strict):
        page += [("h2", say["three"]), ("list", _strict(strict, tables["episodes"], say))]
    if len(tables["paired"]):
        page += [("h2", say["pairs"]), ("table", PAIRED_HEADER, paired_cells(tables["paired"], language))]
        page.append(("p", say["test"]))
    if "ablations" in tables:
        page += [("h2", say["ablations"]), ("p", say["trained"])]
        page.append(("table", PAIRED_HEADER, paired_cells(tables["ablations_paired"], language)))
        page += _figures(("ablations",), drawn, language)
    if len(others):
        arms = list(others.arm.unique())
        page += [("h2", say["published"]), ("table", HEADER, survival_cells(others.assign(source=""), arms, language))]
    more = _figures([name for name in FIGURES if name != "survival"], drawn, language)
    return page + ([("h2", say["figures"]), *more] if more else [])


def _summary(measured: pd.DataFrame, say: Mapping[str, str]) -> list[str]:
    """A line an arm of the policy: how many rows with a rate of the article it beats."""
    lines = []
    for arm, rows in measured.groupby("arm", sort=False):
        found = [stands(row) for row in rows.itertuples() if stands(row)]
        if found and arm.startswith("ppo"):
            counts = {word: found.count(word) for word in ("beaten", "missed", "open")}
            counts["open"] += found.count("met")
            lines.append(say["summary"].format(arm=arm, n=len(found), **counts))
    return lines


def _verdicts(measured: pd.DataFrame, say: Mapping[str, str], names: Mapping[str, str]) -> list[str]:
    """A sentence for each measured row that the article makes a claim about."""
    return [
        say["verdict"].format(
            title=names.get(row.scenario, row.scenario),
            arm=row.arm,
            survived=row.survived,
            episodes=row.episodes,
            low=percent(row.exact_low),
            high=percent(row.exact_high),
            claim=percent(row.article_claim, 0),
            word=say[stands(row)],
        )
        for row in measured.itertuples()
        if stands(row)
    ]


def _strict(strict: pd.DataFrame, episodes: pd.DataFrame, say: Mapping[str, str]) -> list[str]:
    contacts = episodes.groupby(["scenario", "arm"]).contacts.sum()
    lines = []
    for row in strict.itertuples():
        text = say["strict"].format(arm=row.arm, survived=row.survived, episodes=row.episodes)
        known = row.source != PUBLISHED and (row.scenario, row.arm) in contacts
        lines.append(text + (say["contacts"].format(n=contacts[row.scenario, row.arm]) if known else ""))
    return lines


def _figures(names: Sequence[str], drawn: Sequence[str], language: str) -> list[Block]:
    """Blocks of the figures that were drawn; in Chinese where that was drawn, or else in English."""
    found = []
    for name in names:
        files = [f"{name}.zh.svg"] if language == "zh" else []
        file = next((one for one in (*files, f"{name}.svg") if one in drawn), None)
        if file:
            found.append(("figure", f"figures/{file}", CAPTIONS[name][language == "zh"]))
    return found


def as_markdown(page: Sequence[Block], language: str) -> str:
    """The page as Markdown; tables also line up in a terminal."""
    lines: list[str] = []
    for kind, *content in page:
        if kind in ("h1", "h2"):
            lines.append(f"{'#' * int(kind[1])} {content[0]}")
        elif kind == "list":
            lines += [f"- {text}" for text in content[0]]
        elif kind == "table":
            rows = markdown(content[0], content[1])
            rows[0] = "| " + " | ".join(_head(name, language) for name in content[0]) + " |"
            lines += markdown(content[0], content[1]) if language == "en" else rows
        elif kind == "figure":
            lines += [f"![{content[1]}]({content[0]})"]
        else:
            lines.append(content[0])
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _head(name: str, language: str) -> str:
    return name if language == "en" else HEADS.get(name, name)


def as_html(page: Sequence[Block], language: str) -> str:
    """The page as one HTML file beside the folder of figures; follows the reader's choice of light or dark."""
    parts = []
    for kind, *content in page:
        if kind == "list":
            parts.append("<ul>" + "".join(f"<li>{_inline(text)}</li>" for text in content[0]) + "</ul>")
        elif kind == "table":
            parts.append(_html_table(content[0], content[1], language))
        elif kind == "figure":
            image = f'<img src="{content[0]}" alt="{html.escape(content[1])}">'
            parts.append(f"<figure>{image}<figcaption>{_inline(content[1])}</figcaption></figure>")
        else:
            parts.append(f"<{kind}>{_inline(content[0])}</{kind}>")
    code = "en" if language == "en" else "zh-CN"
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{page[0][1]}</title>'
    return (
        f'<!doctype html>\n<html lang="{code}"><head>{head}<style>{STYLE}</style></head>\n<body>\n'
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def _inline(text: str) -> str:
    """Text whose `code` is set apart."""
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", html.escape(text, quote=False))


def _html_table(header: Sequence[str], cells: Sequence[Sequence[str]], language: str) -> str:
    marks = [' class="n"' if name in NUMBERS else "" for name in header]
    top = "".join(f"<th{mark}>{_head(name, language)}</th>" for mark, name in zip(marks, header, strict=True))
    rows = [
        "<tr>" + "".join(f"<td{mark}>{_inline(text)}</td>" for mark, text in zip(marks, row, strict=True)) + "</tr>"
        for row in cells
    ]
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def write_report(
    out: Path,
    tables: Mapping[str, pd.DataFrame],
    command: str,
    failed: Sequence[tuple[str, str]] = (),
    kinds: Sequence[str] = ("md", "html"),
) -> list[Path]:
    """Write `report.md`, `report.html` and the same as `report.zh.*` into a results folder; returns their paths."""
    drawn, written = [path.name for path in (out / "figures").glob("*.svg")], []
    for language, ending in (("en", ""), ("zh", ".zh")):
        page = blocks(tables, command, failed, language, drawn)
        texts = {"md": as_markdown(page, language), "html": as_html(page, language)}
        for kind in kinds:
            written.append(out / f"report{ending}.{kind}")
            write_atomic(written[-1], texts[kind])
    return written
