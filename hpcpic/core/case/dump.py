"""A configuration as the text of a case file."""

from hpcpic.core.case.schema import Section, section_of, unit_of
from hpcpic.core.case.texts import value_text


def dump(config: Section) -> str:
    """libconfig text with every default filled in, which reads back to the same configuration."""
    return "\n".join(group_lines(config, "")) + "\n"


def group_lines(config: Section, indent: str) -> list[str]:
    lines = []
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if value is None:
            continue
        if isinstance(value, Section):
            inner = group_lines(value, indent + "  ")
            if inner or field.default is None:  # a group that may be missing says something by being there
                lines += [f"{indent}{name} = {{", *inner, f"{indent}}};"]
        elif isinstance(value, tuple) and section_of(field):
            lines += [f"{indent}{name} = (", *list_lines(value, indent + "  "), f"{indent});"]
        else:
            comment = f"  # {unit_of(field)}" if unit_of(field) else ""
            lines.append(f"{indent}{name} = {value_text(value)};{comment}")
    return lines


def list_lines(groups: tuple[Section, ...], indent: str) -> list[str]:
    lines = []
    for i, group in enumerate(groups):
        comma = "," if i + 1 < len(groups) else ""
        lines += [f"{indent}{{", *group_lines(group, indent + "  "), f"{indent}}}{comma}"]
    return lines
