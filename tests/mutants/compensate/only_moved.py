# hint: not only moved
def compensate(points, pose_then, pose_now):
    return points + pose_then[:2] - pose_now[:2]
