"""`uv run python -m bench exhibit [--numbers] PATCH …`: make the parts of the gallery that show these patches. The
others stay as they are, and docs/gallery.md says what was measured when; `bench gallery` makes all of it. With
--numbers, pictures and sounds stay too, and without a PATCH it makes the numbers of all."""

import sys

from bench.publish.gallery import WORDS, make, read_words

NUMBERS = "--numbers"


def main(arguments: list[str]) -> int:
    """Make the parts of some patches."""
    words = read_words()[1]
    of_numbers, names = NUMBERS in arguments, [name for name in arguments if name != NUMBERS]
    names = names or (list(words) if of_numbers else [])
    if not names or (unknown := [name for name in names if name not in words]):
        print(f"bench exhibit: {WORDS.name} has no {unknown[0]}" if names else __doc__, file=sys.stderr)
        return 2
    make(names, of_numbers, "exhibit")
    return 0
