"""What lies beyond the robot in its rooms: other worlds, other learners, a robot's computer; nothing else needs it."""
