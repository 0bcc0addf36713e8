"""Which attributes of an object a successor process takes over, as a table beside the object.

Every attribute is either carried or left: one that is in neither list is a defect, which is found
before anything is handed over, and not by jaws that let go.
"""

from collections import OrderedDict, deque
from typing import Any

from litegripd.model.plain import TYPE_KEY, PlainError, check_object, plain_of, value_of


class Carried:
    """The table of one class: the carried attributes with their types, and those that are left.

    A type may be another `Carried`: the object in that attribute is filled, not replaced. Keyed
    and bounded rows are filled, too, so that they keep their bounds.
    """

    def __init__(self, owner: type, *, left: tuple[str, ...] = (), **kinds: Any) -> None:
        self._owner = owner
        self._left = frozenset(left)
        self._kinds = kinds

    def memory(self, source: Any) -> dict[str, Any]:
        """Return what JSON can hold of the carried attributes. Raises `PlainError` for a defect."""
        unknown = vars(source).keys() ^ (self._kinds.keys() | self._left)
        if unknown:
            names = ", ".join(sorted(unknown))
            raise PlainError(f"of {self._owner.__name__} it is not said who takes over: {names}")
        plain = {name: _part(getattr(source, name), kind) for name, kind in self._kinds.items()}
        return {TYPE_KEY: self._owner.__name__, **plain}

    def restore(self, target: Any, plain: Any, where: str = "") -> None:
        """Fill `target` with what `memory` returned. Raises `PlainError` for anything else."""
        where = where or self._owner.__name__
        check_object(plain, self._owner.__name__, {TYPE_KEY, *self._kinds}, where)
        for name, kind in self._kinds.items():
            present, inner = getattr(target, name), f"{where}.{name}"
            if isinstance(kind, Carried):
                kind.restore(present, plain[name], inner)
                continue
            value = value_of(plain[name], kind, inner)
            if isinstance(present, OrderedDict):
                present.clear()
                present.update(value)
            elif isinstance(present, deque):
                present.clear()
                present.extend(value)
            else:
                setattr(target, name, value)


def _part(value: Any, kind: Any) -> Any:
    return kind.memory(value) if isinstance(kind, Carried) else plain_of(value)
