"""`python -m tests.symptoms` writes the table of docs/troubleshooting.md again."""

from tests.symptoms.page import ENDS, HEAD, PAGE, row, split
from tests.symptoms.scenes import SCENES

before, _, after = split(PAGE.read_text(encoding="utf-8"))
rows = "".join(f"{row(scene)}\n" for scene in SCENES)
PAGE.write_text(f"{before}{HEAD}{rows}{ENDS}{after}", encoding="utf-8")
