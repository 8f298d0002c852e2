"""A configuration as the text of a case file."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from hpcpic.core.case.config import Path, dotted
from hpcpic.core.case.schema import Section, section_of, unit_of
from hpcpic.core.case.texts import value_text

Comments = Mapping[str, str]


def dump(config: Section, comments: Comments = MappingProxyType({})) -> str:
    """libconfig text with every default filled in, which reads back to the same configuration.

    comments: key ("species[0].particles") -> what stands behind its value, after the unit.
    """
    return "\n".join(_group(config, (), comments)) + "\n"


def _group(config: Section, path: Path, comments: Comments) -> Iterator[str]:
    """Lines of the settings of a group."""
    for name, field in type(config).model_fields.items():
        value, key = getattr(config, name), (*path, name)
        if value is None:
            continue
        if isinstance(value, Section):
            inner = _indented(_group(value, key, comments))
            if inner or field.default is None:  # a group that may be missing says something by being there
                yield from (f"{name} = {{", *inner, "};")
        elif isinstance(value, tuple) and section_of(field):
            yield from (f"{name} = (", *_indented(_list(value, key, comments)), ");")
        else:
            words = ", ".join(filter(None, (unit_of(field), comments.get(dotted(key)))))
            yield f"{name} = {value_text(value)};{f'  # {words}' if words else ''}"


def _list(groups: tuple[Section, ...], path: Path, comments: Comments) -> Iterator[str]:
    for i, group in enumerate(groups):
        yield from ("{", *_indented(_group(group, (*path, i), comments)), "}," if i + 1 < len(groups) else "}")


def _indented(lines: Iterator[str]) -> list[str]:
    return [f"  {line}" for line in lines]
