# hint: newest observation
def closed_loop(env, choose, seed):
    observation, info = env.reset(seed=seed)
    total, steps = 0.0, 0
    while True:
        _, reward, terminated, truncated, info = env.step(choose(observation, info))
        total, steps = total + reward, steps + 1
        if terminated or truncated:
            return {"reward": total, "steps": steps, "ended": "truncated" if truncated else "terminated"}
