"""Print a data set as JSON, as LeRobot itself reads it.

python read_dataset.py REPO_ID ROOT [FOLDER]

The images of its first camera become FOLDER/0000.png and so on.
Runs in the environment of `make lerobot`; it needs nothing else of this project.
"""

import json
import sys
from pathlib import Path

import numpy as np
from lerobot.datasets import LeRobotDataset
from PIL import Image

dataset = LeRobotDataset(sys.argv[1], root=sys.argv[2])
images = [name for name in dataset.features if name.startswith("observation.images.")]
frames = [
    {
        "episode": int(row["episode_index"]),
        "timestamp": float(row["timestamp"]),
        "observation": [float(value) for value in row["observation.state"]],
        "action": [float(value) for value in row["action"]],
        "images": {name: [*row[name].shape, float(row[name].mean())] for name in images},
    }
    for row in (dataset[index] for index in range(dataset.num_frames))
]
if len(sys.argv) > 3:
    Path(sys.argv[3]).mkdir()
    for index in range(dataset.num_frames):
        pixels = (dataset[index][images[0]].numpy().transpose(1, 2, 0) * 255.0).round()
        Image.fromarray(pixels.astype(np.uint8)).save(Path(sys.argv[3]) / f"{index:04}.png")
names = {name: dataset.features[name]["names"] for name in ("observation.state", "action")}
json.dump({"names": names, "fps": dataset.fps, "frames": frames}, sys.stdout)
