"""What stands under each figure of results, in English and Chinese."""
# ruff: noqa: E501, RUF001  (paragraphs; Chinese punctuation is meant)

from collections.abc import Sequence

CAPTIONS = {
    "survival": (
        "Survival in the stress scenarios. Dot: share of runs that survived; bar: Wilson interval, 95 %. Dashed: what the "
        "article claims for its own policy, which was not measured here. Dotted: best arm that drives blind. Grey line: the "
        "planner that knows where everything is.",
        "各压力场景的存活率。点：存活的比例；线段：95 % Wilson 区间。虚线：文章为其自身策略声称的数值，此处未测量。点线：最好的"
        "盲驾方案。灰线：已知全部真值的规划器（上限）。",
    ),
    "fronts": (
        "Safety against energy, a panel a scenario. Each line is one arm over its preferences (policies) or the scaled top speed "
        "(planners); to the right is safer, down is thriftier. Filled: on the front of all arms of the scenario. Points that spend "
        "more than the reference point of the hypervolume count nothing and are left out.",
        "各场景中的安全与能耗。每条线为一个方案在不同偏好（策略）或不同最高速度（规划器）下的结果；向右更安全，向下更节能。"
        "实心：位于该场景所有方案的联合前沿上。能耗高于超体积参考点的点不计入，图中略去。",
    ),
    "runs": (
        "The article's view (5.1): each run that arrived is a point; large points are dominated by no other run of their arm in "
        "that scenario. How many these are depends on the number of runs, so it measures little.",
        "文章的视角（5.1）：每次到达目标的运行为一个点；大点为同一场景同一方案中不被其他运行支配者。其数目取决于运行次数，因此说明"
        "不了多少问题。",
    ),
    "latency": (
        "Left: wall-clock time of each stage of a control step, medians and tails. Right: ticks from the first scan that shows a "
        "pop-up box to the first command that differs from a twin run without the box (20 stands for 20 and more).",
        "左：每个控制步各阶段的实际用时（中位数与高分位数）。右：从激光首次看到突现箱体，到指令首次与无箱体的孪生运行不同，所经过的"
        "周期数（20 表示 20 及以上）。",
    ),
    "battery_hours": (
        "Three hours on one battery, one run an arm. Dashed: the 15 % of charge and the 520 goals that survival asks for.",
        "一块电池运行三小时，每个方案一次。虚线：存活所要求的 15 % 电量与 520 个目标。",
    ),
    "ablations": (
        "Ablations, trained alike, beside the default (square): survival with Wilson intervals, 95 %. One training each: the "
        "intervals are those of these policies, and another training seed may move a point by more.",
        "消融实验：训练方式相同，与默认设置（方块）对照；存活率与 95 % Wilson 区间。每种只训练一次：区间针对这些策略本身，换一个训练种子"
        "结果的变化可能更大。",
    ),
    "intervention": (
        "What the battery band does: 15 % minus 100 % of charge, 95 % intervals. Commands are those for the same states with only "
        "the band changed; the other measures are of whole runs of the same seeds that begin with either charge.",
        "电量条带的作用：15 % 电量减 100 % 电量之差与 95 % 区间。指令为相同状态下仅改变条带时的输出；其余为相同种子、以两种电量开始的完整"
        "运行。",
    ),
    "perturbed": (
        "Commands of the policy changed within bounds (speed factor 0.7 to 1.15, shift 0.05 m/s, turn factor 0.85 to 1.15) and "
        "driven in the simulator. Left: every point that a method tried, large on its own front. Right: those of the fronts on "
        "seeds that no search saw.",
        "在限度内改变策略的指令（速度系数 0.7 至 1.15，偏移 0.05 m/s，转向系数 0.85 至 1.15）并在仿真中执行。左：各方法尝试过的所有点，"
        "大点位于该方法自身的前沿上。右：前沿上的点在未参与搜索的种子上的结果。",
    ),
    "failures": (
        "Search for settings of a scenario in which the policy fails. Black: the scenario as it is. Yellow: all episodes of a "
        "search. Red: the worst settings that it found, on seeds that it did not see. Wilson intervals, 95 %.",
        "搜索使策略失败的场景参数。黑：原场景。黄：一次搜索的全部运行。红：所找到的最坏参数在未见过的种子上的结果。95 % Wilson 区间。",
    ),
    "trajectories": (
        "Paths of three arms through the same rooms, which are drawn as they stand when the policy arrives. Crosses end in a contact; the dashed frame is what the policy sees last.",
        "三个方案在相同房间中的轨迹；房间按策略到达时的状态绘制。叉号表示以碰撞结束；虚线框为策略最后看到的范围。",
    ),
    "studies": (
        "Variants of one training, judged on the same tuning seeds: a stroke a training seed, a mark their mean, "
        "with its 95 % interval by Student's t. The first variant is what the others are held against. "
        "Axes begin at different rates.",
        "同一训练的不同变体，在相同的调参种子上评判：竖线为单个训练种子，标记为其均值，横线为 Student t 的 95 % 区间。第一个变体为对照。各图横轴起点不同。",
    ),
    "traffic": (
        "Traffic of highway-env: energy of a journey of 300 m over the least gap to another car, means with 95 % intervals. "
        "A line is one training; preference 0 is all safety, 1 all thrift. The planner keeps lane and distance.",
        "highway-env 交通场景：300 m 行程的能耗，对照与其他车辆的最小间隙（均值与 95 % 区间）。每条线为一次训练；偏好 0 为全安全，"
        "1 为全节能。规划器保持车道与车距。",
    ),
    "fleet": (
        "Fleets of two to four robots with the same policy. Left: robots that arrived. Right: mean distance between where "
        "neighbours' lidars predicted a robot for the next 2 s and where it went. Weight 0 is the policy as it is.",
        "两至四台机器人使用同一策略。左：到达目标的机器人比例。右：邻机激光雷达对未来 2 s 的预测与实际轨迹的平均距离。权重 0 为原策略。",
    ),
    "algorithms": (
        "PPO, DQN and SAC on the same worlds, observation (46 numbers) and budget; a point a training seed.",
        "PPO、DQN 与 SAC：相同的环境、观测（46 个数）与训练预算；每点为一个训练种子。",
    ),
    "reward_terms": (
        "Weighted reward terms of one crossing, summed up from its start (linear between -1 and 1, logarithmic beyond); below, speed and clearance of the hull (cut at 1.5 m).",
        "一次穿越中各加权奖励项自起点的累计值（-1 与 1 之间为线性，之外为对数）；下方为速度与机身间隙（1.5 m 以上截去）。",
    ),
}


def caption_lines(names: Sequence[str], language: str) -> str:
    """`captions.md`: a paragraph a figure."""
    place = 0 if language == "en" else 1
    return "\n\n".join(f"**{name}.** {CAPTIONS[name][place]}" for name in names) + "\n"
