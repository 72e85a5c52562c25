# hint: do not stop at 500
def closed_loop(env, choose, seed):
    observation, info = env.reset(seed=seed)
    total, steps, terminated = 0.0, 0, False
    for _ in range(500):
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        total, steps = total + reward, steps + 1
        if terminated or truncated:
            break
    return {"reward": total, "steps": steps, "ended": "terminated" if terminated else "truncated"}
