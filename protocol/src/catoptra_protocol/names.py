"""Names that a user may have meant: the nearest of those that exist, and a list of all.

A misspelt name is the commonest mistake in a configuration, on a command line and in a request.
"""

from __future__ import annotations

from collections.abc import Iterable

# Ratio of equal characters, of difflib: one wrong letter of four, two swapped ones of seven.
MIN_SIMILARITY = 0.7
# In a list of all names a less similar one does no harm: field for field_tour (0.67).
_MIN_LISTED_SIMILARITY = 0.6
# A line of the control protocol holds that many names.
_MAX_LISTED_NAMES = 50


def suggest_name(name: str, known: Iterable[str], min_similarity: float = MIN_SIMILARITY) -> str:
    """Known name that is most similar to a misspelt one, regardless of case; empty for none."""
    import difflib  # for a misspelt name alone

    by_lower_case = {one.lower(): one for one in known}
    found = difflib.get_close_matches(name.lower(), by_lower_case, 1, min_similarity)
    return by_lower_case[found[0]] if found else ""


def list_names(name: str, known: Iterable[str]) -> str:
    """All known names, and of several the nearest to a misspelt one: "a, b; did you mean b?"."""
    names = list(dict.fromkeys(known))
    text = ", ".join(names[:_MAX_LISTED_NAMES]) or "none"
    if num_further := len(names[_MAX_LISTED_NAMES:]):
        text += f" and {num_further} more"
    if len(names) == 1:
        return text
    suggestion = suggest_name(name[:100], names, _MIN_LISTED_SIMILARITY)
    return f"{text}; did you mean {suggestion}?" if suggestion else text
