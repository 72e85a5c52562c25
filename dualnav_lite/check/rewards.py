"""Checks of lesson 07: the truths are worked out by hand from the article's 2.3 and 4.2 and ARTICLE_NOTES 1 to 3."""

import numpy as np

from dualnav_lite import rewards
from dualnav_lite.check.verdict import Text, call, expect, hold
from dualnav_lite.config import Rewards
from dualnav_lite.rewards import Transition

NAMES = ("safe", "dynamic", "energy", "goal", "terminal")

# safe(clearance)

SIGN = Text("the sign of the article's 2.3: here more room costs more", "这是原文 2.3 的符号：空间越大反而罚得越多")
POSITIVE = Text("a penalty is negative: being close must cost", "惩罚应为负值：靠得近必须付出代价")
LINEAR = Text("square the missing distance (article 4.2)", "对缺少的距离取平方（原文 4.2）")
NO_THRESHOLD = Text("from 0.3 m on nothing is missing: clip at 0", "达到 0.3 m 就不缺距离了：请截断为 0")
BELOW_ZERO = Text(
    "hulls that overlap count as touching: a negative clearance is 0", "机身重叠按接触计算：负间隙按 0 处理"
)


def safe_is_the_squared_hinge(mine):
    given = {"clearance": 0.1}
    usual = [(-1.0, SIGN), (0.4, POSITIVE), (-2.0, LINEAR), (2.0, POSITIVE)]
    claim = Text("0.1 m is 0.2 m too close: -10 times 0.2 squared", "0.1 m 比阈值近 0.2 m：-10 乘以 0.2 的平方")
    expect(claim, mine, given, -0.4, usual)


def safe_costs_nothing_far_away(mine):
    claim = Text("from 0.3 m on it costs nothing", "达到 0.3 m 起没有惩罚")
    for clearance in (0.3, 1.0, 5.0):
        wrong = -10.0 * (0.3 - clearance) ** 2
        expect(claim, mine, {"clearance": clearance}, 0.0, [(wrong, NO_THRESHOLD), (-10.0 * clearance, SIGN)])


def safe_counts_overlap_as_contact(mine):
    claim = Text("a contact costs 0.9, however deep", "接触的代价是 0.9，与深度无关")
    expect(claim, mine, {"clearance": -0.1}, -0.9, [(-1.6, BELOW_ZERO)])


def more_room_never_costs_more(mine):
    claim = Text("more room never costs more, for a whole array at once", "空间越大代价不会越高（一次传入整个数组）")
    given = {"clearance": np.linspace(-0.1, 2.0, 22)}
    got = np.asarray(call(claim, mine, given))
    hold(claim, got.shape == (22,), given, "(22,)", str(got.shape))
    hold(claim, bool((np.diff(got) >= -1e-12).all()), given, "", got, SIGN)


# goal(before, after, reached, gamma)

ARTICLE_GOAL = Text(
    "the article's 3 exp(-d / 5): it pays for staying near the goal. Reward the change of Phi",
    "这是原文的 3 exp(-d / 5)：在目标附近停留也有奖励。应当奖励 Phi 的变化",
)
NO_GAMMA = Text("gamma belongs before Phi(s')", "Phi(s') 之前要乘 gamma")
GAMMA_BEFORE = Text("gamma belongs before Phi(s'), the state after the step", "gamma 要乘在步后状态的 Phi(s') 上")
GOAL_SIGN = Text("Phi is minus the way: less way left is a higher Phi", "Phi 是负的路程：剩余路程越短 Phi 越大")
NO_SCALE = Text("Phi = -10 times the way: a metre is worth 10", "Phi = -10 乘以路程：每米值 10")
ARRIVAL = Text(
    "Phi is 0 at arrival (`reached`), though up to 0.4 m of way are left",
    "到达时（`reached`）Phi 为 0，即使还剩不到 0.4 m",
)


def goal_pays_for_progress(mine):
    claim = Text("gamma Phi(s') - Phi(s) for 8 cm of progress", "前进 8 cm 时的 gamma Phi(s') - Phi(s)")
    given = {"before": 3.0, "after": 2.92, "reached": False, "gamma": 0.9}
    usual = [
        (3.0 * np.exp(-2.92 / 5.0), ARTICLE_GOAL),
        (0.8, NO_GAMMA),
        (-29.2 + 27.0, GAMMA_BEFORE),
        (0.9 * 29.2 - 30.0, GOAL_SIGN),
        (0.3 - 0.0292 * 9.0, NO_SCALE),
        (3.0 - 0.9 * 2.92, NO_SCALE),
    ]
    expect(claim, mine, given, 0.9 * -29.2 + 30.0, usual)


def goal_counts_arrival_as_no_way_left(mine):
    claim = Text("at arrival Phi is 0, so the way that was left is paid", "到达时 Phi 为 0，剩余的路程全部得到奖励")
    given = {"before": 0.45, "after": 0.38, "reached": True, "gamma": 1.0}
    expect(claim, mine, given, 4.5, [(0.7, ARRIVAL)])


def there_and_back_pays_nothing(mine):
    claim = Text("with gamma 1 a walk that returns pays nothing in total", "gamma 为 1 时，走出去再回来总奖励为 0")
    way = np.array([4.0, 3.0, 1.5, 2.5, 4.0])
    given = {"before": way[:-1], "after": way[1:], "reached": np.zeros(4, bool), "gamma": 1.0}
    got = np.asarray(call(claim, mine, given))
    hold(claim, got.shape == (4,) and abs(got.sum()) < 1e-9, given, "0", got.sum(), ARTICLE_GOAL)


# reward_terms(t)


def a_transition(**changes) -> Transition:
    """A step in the middle of a run, driven past something at 0.1 m."""
    values = {
        "clearance": 0.1,
        "min_range": 0.3,
        "action": np.array([0.5, 0.2]),
        "mover_velocity": np.array([0.0, 0.8]),
        "predicted_velocity": np.array([0.0, 0.6]),
        "intrusion": 0.25,
        "energy_j": 2.0,
        "reference_j": 4.0,
        "path_before": 3.0,
        "path_after": 2.92,
        "goal_distance": 2.5,
        "reached": False,
        "collided": False,
        "flat_battery": False,
    }
    return Transition(**(values | changes))


def _given(t: Transition) -> dict:
    return {"t": t}


def terms_have_their_names(mine):
    claim = Text(f"a dictionary with the keys {', '.join(NAMES)}", f"返回字典，键为 {', '.join(NAMES)}")
    got = call(claim, mine, _given(a_transition()))
    hold(claim, isinstance(got, dict) and set(got) == set(NAMES), "", ", ".join(NAMES), got)


FROM_HULL = Text(
    "`clearance` is measured from the hull, `min_range` from the lidar",
    "`clearance` 从机身量起，`min_range` 从激光雷达量起",
)
WEIGHTED = Text("weights come later: return the bare terms", "权重稍后再乘：这里返回未加权的项")
PREDICTION = Text(
    "the article's term: it pays for predicting well. Penalise `t.intrusion`",
    "这是原文的项：奖励的是预测准确。请惩罚 `t.intrusion`",
)
SPENT = Text("spending energy must cost: the sign", "消耗能量应付出代价：符号反了")
COMMANDED = Text(
    "the article's |v| + 0.5 |omega|: the same for any speed over a given way. Use joules",
    "这是原文的 |v| + 0.5 |omega|：同一段路程不论快慢都一样。请用焦耳",
)
INTEREST = Text(
    "gamma 1 in here: with 0.99 a robot that stands still earns interest on the way it has left",
    "这里 gamma 取 1：取 0.99 时，站着不动也会按剩余路程得到“利息”",
)
UNSCALED = Text("times ENERGY_SCALE", "还要乘以 ENERGY_SCALE")
NO_REFERENCE = Text("joules of this step over those of a step at full speed", "本步焦耳数除以全速一步的焦耳数")


def each_term_is_right(mine):
    expected = {"safe": -0.4, "dynamic": -0.25, "energy": -0.02, "goal": 0.8, "terminal": 0.0}
    usual = {
        "safe": [(-10.0 * 0.3, SIGN), (0.0, FROM_HULL), (-0.18, WEIGHTED)],
        "dynamic": [(0.25, POSITIVE), (-0.2 * 5.0, PREDICTION), (-0.0625, WEIGHTED)],
        "energy": [(0.02, SPENT), (-(0.5 + 0.1) * 2.0, COMMANDED), (-0.5, UNSCALED), (-0.08, NO_REFERENCE)],
        "goal": [(3.0 * np.exp(-2.5 / 5.0), ARTICLE_GOAL), (0.99 * -29.2 + 30.0, INTEREST)],
        "terminal": [],
    }
    for name in NAMES:
        claim = Text(f"'{name}' of a step in the middle of a run", f"途中一步的 '{name}'")
        expect(claim, _one(mine, name), _given(a_transition()), expected[name], usual[name])


def _one(mine, name):
    """The student's function, reduced to one term."""

    def chosen(t):
        return mine(t)[name]

    return chosen


def the_end_is_paid_once(mine):
    missing = Text(
        "without it a crash is a way to end the penalties early", "没有终止奖励，撞毁就成了提前结束惩罚的办法"
    )
    sign = Text("arrival +10, contact and flat battery -10", "到达 +10，接触与电量耗尽 -10")
    claim = Text("'terminal': arrival is worth 10", "'terminal'：到达值 10")
    terminal = _one(mine, "terminal")
    expect(claim, terminal, _given(a_transition(reached=True)), 10.0, [(0.0, missing), (-10.0, sign)])
    claim = Text("'terminal': a contact costs 10", "'terminal'：接触罚 10")
    expect(claim, terminal, _given(a_transition(collided=True)), -10.0, [(0.0, missing), (10.0, sign)])
    claim = Text("'terminal': a flat battery costs 10", "'terminal'：电量耗尽罚 10")
    forgotten = Text("`t.flat_battery` is a failure too", "`t.flat_battery` 也是失败")
    expect(claim, terminal, _given(a_transition(flat_battery=True)), -10.0, [(0.0, forgotten), (10.0, sign)])
    claim = Text("'terminal': who touches something at the goal has failed", "'terminal'：在目标处碰到东西也算失败")
    both = Text("look at the failure first: it must not be paid as well", "先看失败：不能既罚又奖")
    expect(claim, terminal, _given(a_transition(reached=True, collided=True)), -10.0, [(10.0, both), (0.0, both)])


# reward_weights(preference, charge)

SWAPPED = Text("preference 0 is all safety, 1 all thrift", "偏好 0 表示只要安全，1 表示只要节能")
CHARGE = Text(
    "w_energy grows as the battery empties: times 1 + 3 (1 - charge)", "电量越低 w_energy 越大：乘以 1 + 3 (1 - charge)"
)


def half_and_full_are_the_articles(mine):
    claim = Text(
        "preference 0.5 at full charge: the article's weights, terminal 1", "偏好 0.5、满电：原文的权重，terminal 为 1"
    )
    doubled = Text("times 2, so that 0.5 changes nothing", "要乘 2，使 0.5 时权重不变")
    usual = [(np.array([0.225, 0.25, 0.10, 0.10, 1.0]), doubled), (np.array([0.45, 0.25, 0.80, 0.10, 1.0]), CHARGE)]
    expect(claim, mine, {"preference": 0.5, "charge": 1.0}, np.array([0.45, 0.25, 0.20, 0.10, 1.0]), usual)


def all_safety_forgets_energy(mine):
    claim = Text("preference 0: safety doubled, energy free", "偏好 0：安全加倍，能耗不计")
    given = {"preference": 0.0, "charge": 0.5}
    swapped = np.array([0.0, 0.25, 0.20 * 2 * 2.5, 0.10, 1.0])
    unmoved = np.array([0.45, 0.25, 0.20 * 2.5, 0.10, 1.0])
    ignored = Text("the preference changes nothing yet", "偏好还没有起作用")
    expect(claim, mine, given, np.array([0.9, 0.25, 0.0, 0.10, 1.0]), [(swapped, SWAPPED), (unmoved, ignored)])


def a_low_battery_makes_energy_dear(mine):
    claim = Text("preference 0.5 at 20 % charge: energy counts 3.4 times", "偏好 0.5、电量 20 %：能耗权重为 3.4 倍")
    right = np.array([0.45, 0.25, 0.20 * 3.4, 0.10, 1.0])
    constant, turned = right.copy(), right.copy()
    constant[2], turned[2] = 0.20, 0.20 * 1.6
    expect(claim, mine, {"preference": 0.5, "charge": 0.2}, right, [(constant, CHARGE), (turned, CHARGE)])


CHECKS = {
    "safe": [
        safe_is_the_squared_hinge,
        safe_costs_nothing_far_away,
        safe_counts_overlap_as_contact,
        more_room_never_costs_more,
    ],
    "goal": [goal_pays_for_progress, goal_counts_arrival_as_no_way_left, there_and_back_pays_nothing],
    "reward_terms": [terms_have_their_names, each_term_is_right, the_end_is_paid_once],
    "reward_weights": [half_and_full_are_the_articles, all_safety_forgets_energy, a_low_battery_makes_energy_dear],
}
REFERENCES = {
    "safe": rewards.hinge,
    "goal": rewards.shaping,
    "reward_terms": lambda t: rewards.reward_terms(t, Rewards()),
    "reward_weights": lambda preference, charge: rewards.reward_weights(preference, charge, Rewards()),
}
