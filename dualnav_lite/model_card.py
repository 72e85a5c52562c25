"""The card of the shipped policy, `models/README.md`, and its table in the two READMEs: from files, log and rows."""

import csv
from pathlib import Path

import pandas as pd
import yaml

from dualnav_lite.cases import all_cases
from dualnav_lite.chunks import sha256
from dualnav_lite.config import ROOT, UnusableInput, write_atomic
from dualnav_lite.drivers import MODEL_FOLDER, EmbeddedPolicy
from dualnav_lite.judge import REFERENCE
from dualnav_lite.policy_tables import band_lines, paired_lines, preference_lines, training_lines
from dualnav_lite.predictor import load as load_predictor
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import read_episodes, survival

BEGIN, END = "<!-- written by: python -m dualnav_lite card -->", "<!-- end -->"
READMES = {
    "README.md": (
        "| scenario | article | survived | exact 95 % |",
        "{title} | {claim} | {survived:,} of {episodes:,} | {low:.1%} to {high:.1%}",
        "The three-hour runs end with {least:.0%} to {most:.0%} of the charge (article: 15 %).",
    ),
    "README.zh-CN.md": (
        "| 场景 | 文章 | 存活 | 精确 95 % 区间 |",
        "{title} | {claim} | {episodes:,} 次中 {survived:,} 次 | {low:.1%} 至 {high:.1%}",
        "三小时运行结束时剩余电量 {least:.0%} 至 {most:.0%}（文章：15 %）。",
    ),
}
WHAT = {
    "ppo_actor.onnx": "the policy that `ppo` and `ppo_filter` drive with (ONNX Runtime, one thread)",
    "ppo_actor.pt": "the same as TorchScript",
    "ppo_actor.pth": "its weights",
    "ppo_critic.pth": "the value heads, one a reward term",
    "predictor.pth": "the LSTM predictor",
    "predictor.npz": "its weights once more, for the environment, which needs no torch",
}
FOLDERS = {
    "ablations": "the arms `ablation_*`: `training/studies/ablation.yaml`, one training each",
    "trainings": "the recipe with other training seeds: before PPO (`imitated_`) and after (`record_`)",
}


def files_table(folder: Path) -> list[str]:
    """Lines of Markdown: each weight file with its size and fingerprint, then folders of policies."""
    lines = ["| file | what | MB | SHA-256 |", "|---|---|---|---|"]
    for name, what in WHAT.items():
        path = folder / name
        if path.exists():
            content = path.read_bytes()
            digest = sha256(content)[:12]
            lines.append(f"| `{name}` | {what} | {len(content) / 1e6:.2f} | {digest} |")
    for name, what in FOLDERS.items():
        sizes = [path.stat().st_size for path in (folder / name).glob("*.onnx")]
        if sizes:
            count = f"{len(sizes)} file{'s' * (len(sizes) > 1)}"
            lines.append(f"| `{name}/*.onnx` | {what} | at most {max(sizes) / 1e6:.2f} | {count} |")
    return lines


def stage_lines(log: Path) -> list[str]:
    """What each stage of a training's `log.csv` ended with."""
    with open(log, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = []
    for stage in dict.fromkeys(row["stage"] for row in rows):
        last = [row for row in rows if row["stage"] == stage][-1]
        unit = "labels" if last.get("round") else "steps"
        lines.append(
            f"- stage `{stage}`: {int(last['step']):,} {unit}; the last ones reached {float(last['reached']):.0%}"
        )
    return lines


def rate_table(rows: pd.DataFrame) -> list[str]:
    """Lines of Markdown: survival with exact intervals, an arm and scenario a line."""
    lines = [
        "| scenario | arm | survived | 95 % (exact) | clearance [m] | energy [J] |",
        "|---|---|---|---|---|---|",
    ]
    for row in survival(rows).itertuples():
        interval = f"{row.exact_low:.1%} to {row.exact_high:.1%}"
        means = f"{row.mean_min_clearance_m:.2f} | {row.mean_energy_j:.0f}"
        lines.append(f"| {row.scenario} | {row.arm} | {row.survived} of {row.episodes} | {interval} | {means} |")
    return lines


def readme_lines(name: str, rows: pd.DataFrame) -> list[str]:
    """What `ppo` does in the scenarios of the suite, for one of the READMEs, in its language."""
    head, line, charge = READMES[name]
    rows = rows[rows.arm == "ppo"]
    found = {row.scenario: row for row in survival(rows).itertuples()}
    lines = [head, "|---|---|---|---|"]
    for scenario in (name for case in all_cases().values() for name in case.scenarios if name in found):
        about, row = load_scenario(scenario), found[scenario]
        numbers = {"survived": row.survived, "episodes": row.episodes, "low": row.exact_low, "high": row.exact_high}
        title = about.title_zh if name.endswith("zh-CN.md") else about.title
        claim = f"{about.article_claim:.0%}" if about.article_claim else ""
        lines.append("| " + line.format(title=title, claim=claim, **numbers) + " |")
    ends = rows[rows.scenario == "battery"].battery_end
    return [*lines, "", charge.format(least=ends.min(), most=ends.max())] if len(ends) else lines


def write_readmes(rows: pd.DataFrame, folder: Path = ROOT) -> None:
    """Write the table between its two marks in each README."""
    for name in READMES:
        before, _, rest = (folder / name).read_text(encoding="utf-8").partition(BEGIN)
        _, mark, after = rest.partition(END)
        if not mark:
            raise UnusableInput(f"{folder / name}: no '{BEGIN}' with '{END}' after it")
        write_atomic(folder / name, before + "\n".join([BEGIN, *readme_lines(name, rows), mark]) + after)


def predictor_lines(folder: Path) -> list[str]:
    """Where the shipped predictor comes from, and its rows beside constant velocity; nothing where none is shipped."""
    if not (folder / "predictor.pth").exists():
        return []
    card = load_predictor(folder / "predictor.pth")[1]
    training = yaml.safe_load(card["training"])
    families = ", ".join(f"`{Path(name).stem}` {episodes}" for name, episodes in training["families"].items())
    lines = [
        "## The predictor",
        "",
        f"`python kit.py train --config training/predictor.yaml --out models`, seed {training['seed']}:",
        f"{card['samples']:,} movers at moments of drives ({families} episodes),",
        f"{training['fit']['updates']:,} updates. Scenarios that it has not seen, metres and shares",
        "(`python kit.py predictor --episodes 60 --out stress_tests/reference`):",
        "",
    ]
    with open(REFERENCE / "predictor.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    cells = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return [*lines, *("| " + " | ".join(row) + " |" for row in cells), ""]


def section_lines(title: str, told: str, table: list[str]) -> list[str]:
    """A section: its title, what the table shows, the table."""
    return ["", f"## {title}", "", told, "", *table]


def policy_lines(rows: pd.DataFrame, reference: Path = REFERENCE) -> list[str]:
    """Sections on the filter, on other trainings and on what the policy's bands do; of tables that are there."""
    lines = (
        section_lines(
            "The filter",
            "Points of survival that the filter adds or takes on the same seeds (95 %).",
            paired_lines(rows, [("ppo_filter", "ppo")]),
        )
        if {"ppo", "ppo_filter"} <= set(rows.arm)
        else []
    )
    trainings = reference / "trainings_tuning.csv.gz"
    if trainings.exists():
        lines += section_lines(
            "Other trainings",
            "The same seeds for every policy of `trainings/`: the recipe with other training seeds, before PPO\n"
            "(`imitated_`) and after (`record_`). Below, what PPO changes (95 %): points of survival, then what\n"
            "a run takes, over the seeds that both policies survive.",
            training_lines(read_episodes(trainings), rows),
        )
    for name, title, told, table in (
        ("trade", "Preference", "200 test seeds each (`trade.csv`); 0 is all safety, 1 all thrift.", preference_lines),
        (
            "intervention",
            "Battery",
            "Commands on the same states, the battery's band alone changed (`intervention.csv`).",
            band_lines,
        ),
    ):
        if (reference / f"{name}.csv").exists():
            lines += section_lines(title, told, table(pd.read_csv(reference / f"{name}.csv", encoding="utf-8")))
    return lines


def write_card(
    training: str, log: Path, rows: Path, commit: str, minutes: float, folder: Path = MODEL_FOLDER, readmes: Path = ROOT
) -> Path:
    """Write the card and the table of the READMEs.

    Args:
        training: the config's path in the repository.
        log: `log.csv` of the run.
        rows: an `episodes.csv` (also compressed) of the policy on tuning seeds.
        commit: of the code that trained; minutes: wall-clock time it took.
        folder: of the weights; the card goes beside them.
        readmes: the folder of the two READMEs.

    Raises:
        UnusableInput: a file that is missing or unusable.
    """
    for path in (log, rows):
        if not Path(path).exists():
            raise UnusableInput(f"{path}: no such file")
    policy, table = EmbeddedPolicy(folder / "ppo_actor.onnx"), read_episodes(rows)
    seeds = f"{table.seed.min():,} to {table.seed.max():,}"
    lines = [
        "# Models",
        "",
        *files_table(folder),
        "",
        "Every file is under 8 MB; weights load with `weights_only=True`. This page is written by",
        "`python -m dualnav_lite card`, from the files, the training's log and evaluated rows.",
        "",
        "## The policy",
        "",
        f"`python kit.py train --config {training}`, seed {policy.training_seed},",
        f"code of commit {commit}, {minutes:.0f} minutes on two cores:",
        "",
        *stage_lines(log),
        "",
        f"It sees {policy.card['observation']['motion']['method']} in the motion channel and the guide point"
        f" (`{policy.card['guide']['method']}`), and chooses from a grid of",
        "commands, read between its points by a vote of the last steps"
        f" (memory {policy.card['memory']}); outside, v and omega are continuous.",
        "",
        *predictor_lines(folder),
        f"## Tuning seeds ({seeds})",
        "",
        *rate_table(table),
        *policy_lines(table),
    ]
    path = folder / "README.md"
    write_atomic(path, "\n".join(lines) + "\n")
    write_readmes(table, readmes)
    return path
