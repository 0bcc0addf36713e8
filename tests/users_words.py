"""What users can say: reasons, paths and names that look like what the daemon says itself."""

from hypothesis import strategies as st

from litegrip_client.values.voices import ARGUMENTS, CALLS

PARAMETERS = sorted({name for names in ARGUMENTS.values() for name in names})
PIECES = [
    *CALLS,
    *PARAMETERS,
    *(f"{{{name}}}" for name in CALLS),
    *(f"{{.{name}}}" for name in PARAMETERS),
    *(
        "{",
        "}",
        "{{",
        "}}",
        "{0}",
        "{who}",
        "%s",
        "<force_n>",
        ": ",
        "; ",
        ".",
        "/",
        '"',
        "'",
        "\\",
    ),
    *("calibration.zero with a mount", "clear it with stop.clear first", "motion.open: ", "terms"),
    *("/data/force_n.csv", "/a/stop.clear.json", "gripper.goto()", "--force", "litegripctl clear"),
    *("é", "日本", "🦾"),
]


def any_words(longest: int = 80) -> st.SearchStrategy[str]:
    """Return printable texts without blanks around them, as a stop's reason must be."""
    glued = st.lists(st.sampled_from(PIECES), min_size=1, max_size=6)
    texts = st.tuples(st.sampled_from(["", " "]), glued).map(lambda pair: pair[0].join(pair[1]))
    return texts.map(lambda text: text[:longest].strip()).filter(
        lambda text: text.isprintable() and bool(text)
    )
