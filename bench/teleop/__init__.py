"""A follower behind its leader, over networks good and bad."""
