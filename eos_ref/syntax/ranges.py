"""Lists of atom types as the manual writes them: ``*``, ``n``, ``*n``, ``m*``, ``m*n``."""

from __future__ import annotations

import re

from eos_ref.errors import InputError

# ASCII digits only (\d admits those of every script), and no more than any count of types can have.
_FORM = re.compile(r"(?P<single>[0-9]{1,18})|(?P<low>[0-9]{1,18})?\*(?P<high>[0-9]{1,18})?")


def type_range(text: str, ntypes: int, where: str = "") -> range:
    """Return the atom types that a wild-card expression stands for.

    Parameters
    ----------
    text : str
        ``n`` one type, ``*`` all types, ``*n`` 1 to n, ``m*`` m to N, ``m*n`` m to n, all inclusive.
    ntypes : int
        Number of atom types N.
    where : str, optional
        Place of the expression, for the message.

    Returns
    -------
    range
        The 1-based types.

    Raises
    ------
    InputError
        Malformed, reversed, or outside 1 to N.

    Source: manual, fix rheo/pressure, description of *types*.
    """
    match = _FORM.fullmatch(text)
    if match is None:
        raise InputError(
            "type range", "must be *, n, *n, m* or m*n with whole numbers of at most 18 digits", text, where
        )
    if match["single"]:
        low = high = int(match["single"])
    else:
        low = int(match["low"] or 1)
        high = int(match["high"] or ntypes)
    if match["low"] and match["high"] and low > high:
        raise InputError("type range", "must not be reversed (m*n needs m <= n)", text, where)
    if low < 1 or high > ntypes or low > high:
        raise InputError("type range", f"must lie within the atom types 1 to {ntypes}", text, where)
    return range(low, high + 1)
