"""Write what the golden runs are held against, or all that they put out.

python -m tests.golden            write kept.json anew, from this code
python -m tests.golden FOLDER     write every frame and line into FOLDER, to compare two versions
"""

import json
import sys
from pathlib import Path

from tests.golden.scenes import SCENES

KEPT = Path(__file__).parent / "kept.json"


def main() -> None:
    """Do what the arguments say."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    digests = {}
    for name, play in SCENES.items():
        world = play()
        digests[name] = world.digest()
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            text = "\n".join(world.kept) + "\n"
            (folder / f"{name}.txt").write_text(text, encoding="utf-8")
    if folder is None:
        KEPT.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
    for name, digest in digests.items():
        print(f"{name:48}{digest['frames']:8}{digest['lines']:8}  {digest['sha256'][:12]}")


if __name__ == "__main__":
    main()
