"""What an installation brings: each library that users get is named with its licence."""

import re

from tests.packaging.requirements import ROOT, of_users


def test_every_library_of_users_is_named_with_a_licence() -> None:
    libraries = {re.split(r"[^\w-]", row)[0] for row in of_users()}
    assert len(libraries) >= 8
    page = (ROOT / "docs/installation.md").read_text(encoding="utf-8").replace("\n", " ")
    for library in libraries:
        assert re.search(rf"\b{library} \([^)]+\)", page), library
