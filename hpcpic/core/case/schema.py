"""Typed, frozen configurations: validation of a tree with the place of every fault."""

import difflib
import functools
import math
import re
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from hpcpic.core.case.cases import stranger
from hpcpic.core.case.config import Path, Place, Tree, dotted, is_whole, put_value
from hpcpic.core.case.texts import value_text
from hpcpic.core.case.words import SYNONYMS
from hpcpic.core.errors import ConfigError

REQUIRED = ...
MOST_TOLD = 100  # of the faults of a case
MOST_NAMED = 12  # keys of a group, where none is like the one that is wrong


class Section(BaseModel):
    """A group of settings: frozen, no unknown keys. An integer widens to float; `validate` takes 1e4 for an integer."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    # dotted keys ("plot", "species.charge_mass_ratio") that are accepted and have no effect
    ignored: ClassVar[tuple[str, ...]] = ()
    # keys ("fluid[].kinematic_viscosity") that `modernised` understands beside those of the schema
    rewritten: ClassVar[tuple[str, ...]] = ()
    # keys that a user may look for here and that there are not, and numbers that are no list -> what is done instead
    instead: ClassVar[Mapping[str, str]] = {}
    # largest magnitude of a number, the inverse of the smallest: products of a few must stay in floating point
    largest: ClassVar[float] = math.inf

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name}: a configuration never changes; case.changed({{...}}) makes another case")

    @classmethod
    def modernised(cls, tree: Tree) -> None:
        """Rewrite older spellings in the tree before it is validated; notes go to tree.warnings."""


Model = TypeVar("Model", bound=Section)
Value = TypeVar("Value")
if typing.TYPE_CHECKING:  # a key that may be left out; a complete case, which is what programs read, has it
    Filled = Annotated[Value, "filled"]
else:
    Filled = Value | None
Fault = tuple[Path, str]  # the key to change, and what is wrong with it


def setting(default: Any, text: str, unit: str = "", **limits: Any) -> Any:
    """A field with its sentence and unit for `show`; limits are pydantic's (gt, ge, le, min_length ...)."""
    return Field(default, description=text, json_schema_extra={"unit": unit}, **limits)


def as_tuple(value: Any) -> Any:
    """Lists and lone scalars become tuples: `space_length = 64.0` is a vector of one component."""
    if isinstance(value, list):
        return tuple(value)
    return value if isinstance(value, (tuple, dict)) else (value,)


def as_points(value: object) -> object:
    """One position, or a list of them: always a tuple of tuples."""
    value = as_tuple(value)
    if isinstance(value, tuple) and value and not isinstance(value[0], (list, tuple)):
        return (value,)
    return tuple(as_tuple(point) for point in value) if isinstance(value, tuple) else value


Vector = Annotated[tuple[float, ...], BeforeValidator(as_tuple)]
Points = Annotated[tuple[tuple[float, ...], ...], BeforeValidator(as_points)]
Counts = Annotated[tuple[Annotated[int, Field(ge=1)], ...], BeforeValidator(as_tuple)]
Integers = Annotated[tuple[int, ...], BeforeValidator(as_tuple)]
Lengths = Annotated[tuple[Annotated[float, Field(gt=0)], ...], BeforeValidator(as_tuple)]


def validate(
    model: type[Model],
    tree: Tree,
    checks: Callable[[Model], Iterable[Fault]] = lambda config: (),
    complete: Callable[[Model], Model] = lambda config: config,
) -> Model:
    """The typed configuration of a tree of settings. Raises ConfigError with every fault, each with its place and key.

    checks(config): what is wrong between settings that are each right. complete(config): the same configuration with
    everything filled in that other settings determine.
    """
    model.modernised(tree)
    drop_ignored(model, tree)
    messages = list(tree.faults)
    try:
        config = typed(model, tree)
    except ValidationError as error:
        file = tree.files[0][0] if tree.files else ""
        if not tree.incomplete and (other := stranger(model.model_fields, tree.data, file)):
            raise ConfigError(f"{tree.where(())}: {other}") from None
        found = [fault for fault in error.errors() if not (tree.incomplete and fault["type"] == "missing")]
        wrong = {fault["loc"][:-1] for fault in found}  # a list is too short without its elements that are wrong
        found = [fault for fault in found if fault["type"] != "too_short" or fault["loc"] not in wrong]
        found.sort(key=lambda fault: position(tree.where(known_path(tree, fault))))
        messages += [described(model, tree, fault) for fault in found[:MOST_TOLD]]
        if len(found) > MOST_TOLD:
            messages.append(f"and {len(found) - MOST_TOLD} more")
        raise ConfigError(messages) from None
    faults = list(magnitude_faults(config)) or list(checks(config))  # relations of such numbers need not be computable
    messages += [f"{tree.where(path)}: {dotted(path)}: {text}" for path, text in faults]
    if messages:
        raise ConfigError(messages)
    return complete(config)


def typed(model: type[Model], tree: Tree) -> Model:
    """The configuration of a tree. Where an integer is asked for, 1e4 is one: it is written into the tree."""
    try:
        return model.model_validate(tree.data)
    except ValidationError as error:
        found = [(known_path(tree, fault), fault["input"]) for fault in error.errors() if fault["type"] == "int_type"]
        whole = [(path, value) for path, value in found if is_whole(value)]
        if not whole:
            raise
    for path, value in whole:
        put_value(tree.data, path, int(value))
    return model.model_validate(tree.data)


def magnitude_faults(config: Section) -> Iterator[tuple[Path, str]]:
    """Numbers so large or small that products of a few of them leave floating point."""
    most = config.largest
    for path, value in numbers(config, ()):
        if value and not 1 / most <= abs(value) <= most:
            text = f"is beyond what is computed with (got {value:g}); 0 or {1 / most:g} to {most:g}: choose other units"
            yield path, text


def numbers(value: Any, path: Path) -> Iterator[tuple[Path, float]]:
    """Every float in a configuration, with its place."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, Section):
        for name in type(value).model_fields:
            yield from numbers(getattr(value, name), (*path, name))
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from numbers(item, (*path, i))


def drop_ignored(model: type[Section], tree: Tree) -> None:
    """Take the keys that have no meaning here out of the tree, with one warning that lists them."""
    for key in model.ignored:
        *groups, name = key.split(".")
        for path in matching(tree.data, tuple(groups)):
            if tree.has((*path, name)):
                tree.drop((*path, name))
                tree.ignored.append(dotted((*path, name)))
    if tree.ignored:
        tree.warnings.append(f"keys without meaning here, ignored: {', '.join(tree.ignored)}")


def matching(data: Any, groups: tuple[str, ...]) -> list[Path]:
    """The paths of the groups called so; a list of groups gives one path for each element."""
    paths: list[Path] = [()]
    for name in groups:
        following: list[Path] = []
        for path in paths:
            value = data
            for key in path:
                value = value[key]
            inner = value.get(name)
            if isinstance(inner, dict):
                following.append((*path, name))
            elif isinstance(inner, (tuple, list)):
                following += [(*path, name, i) for i, item in enumerate(inner) if isinstance(item, dict)]
        paths = following
    return paths


def position(place: Place) -> tuple[str, int, int]:
    """Sort key: places of one file in the order of reading."""
    return place.file, place.line, place.column


def known_path(tree: Tree, fault: Any) -> Path:
    """The path of what is wrong; pydantic adds the names of the alternatives of a union."""
    path = fault["loc"]
    while path and not tree.has(path) and fault["type"] != "missing":
        path = path[:-1]
    return path


def described(model: type[Section], tree: Tree, fault: Any) -> str:
    """One line: place, key, what is wrong, what was got, what may have been meant."""
    path = known_path(tree, fault)
    got, kind = fault["input"], fault["type"]
    if kind == "missing":
        text, hint, shown = "missing, and there is no default", replaced(tree, path), ""
    elif kind == "extra_forbidden":
        text, hint, shown = "unknown key", nearest_key(model, path), ""
    else:
        text = fault["msg"].replace("Input should be ", "must be ").replace("Value error, ", "")
        text, shown = plain_words(text), f" (got {abridged(got)})"
        choices = [
            word.strip("'") for word in fault.get("ctx", {}).get("expected", "").replace(" or ", ", ").split(", ")
        ]
        lower = {choice.lower(): choice for choice in choices}
        near = difflib.get_close_matches(got.lower(), lower, 1, 0.3) if isinstance(got, str) else []
        hint = f"; did you mean {lower[near[0]]!r}?" if near and kind == "literal_error" else ""
        if isinstance(got, list) and "a number" in text:
            hint = done_instead(group_of(model, path), path)
    return f"{tree.where(path)}: {dotted(path) or 'case'}: {text}{shown}{hint}"


def replaced(tree: Tree, path: Path) -> str:
    """A note where a list around a setting has replaced one that another file gave; else empty."""
    for depth in range(1, len(path)):
        if path[:depth] in tree.replaced:
            return f" ({dotted(path[:depth])} here takes the place of the whole list at {tree.replaced[path[:depth]]})"
    return ""


def plain_words(text: str) -> str:
    text = re.sub(r"\w+ should have (at \w+ \d+) items? after validation, not \d+", r"needs \1 value(s)", text)
    for words, plain in (
        ("a valid dictionary or instance of", "a group { } for"),
        ("a valid tuple", "a list ( )"),
        ("a valid integer", "an integer"),
        ("a valid number", "a number"),
        ("a valid string", 'a text in " "'),
        ("a valid boolean", "true or false"),
        ("must be True", "must be true"),
    ):
        text = text.replace(words, plain)
    return text


def abridged(value: Any) -> str:
    """A value as shown in a message: one line, 60 characters at most, nothing a terminal would obey."""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = "a group { }" if isinstance(value, dict) else ascii(value)
    return text if len(text) <= 60 else text[:57] + "..."


def group_of(model: type[Section], path: Path) -> type[Section]:
    """The section that has the key at `path`."""
    own = model
    for part in path[:-1]:
        own = (section_of(own.model_fields[part]) or own) if isinstance(part, str) else own
    return own


def done_instead(own: type[Section], path: Path) -> str:
    """What a section says that is done in place of such a key, as the end of a message; empty where it says nothing."""
    return f"; {own.instead[str(path[-1])]}" if path[-1] in own.instead else ""


def nearest_key(model: type[Section], path: Path) -> str:
    """The known key meant by the last one of `path`: what the field calls so, in its own group or, if no key has that
    name, elsewhere; else the most like it in its own group, one of that name anywhere, or one that is a word of it;
    else all of a small group.
    """
    *groups, name = path
    own = group_of(model, path)
    if told := done_instead(own, path):
        return told
    place = re.sub(r"\[\d+\]", "[]", dotted(tuple(groups)))
    elsewhere = [key for key in keys_of(model) if key.rpartition(".")[2] == name]
    for word in SYNONYMS.get(str(name).lower(), ()):
        found = [key for key in keys_of(model) if key.rpartition(".")[2] == word]
        beside = f"{place}.{word}" in found
        if found and (beside or (len(str(name)) > 1 and not elsewhere)):
            meant = dotted((*groups, word)) if beside else found[0]
            return f"; did you mean {meant!r}?"
    near = difflib.get_close_matches(str(name), own.model_fields, 1, 0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    if not elsewhere:
        words = {*str(name).lower().split("_")}  # magnetic_field: field.magnetic, not output.sampling_period.field
        parts = {key: key.split(".") for key in keys_of(model)}
        among = [key for key in parts if parts[key][-1] in words]
        elsewhere = sorted(among, key=lambda key: -len(words.intersection(parts[key])))
    outside = " outside of all groups" if elsewhere and "." not in elsewhere[0] else ""
    if elsewhere:
        return f"; did you mean {elsewhere[0]!r}{outside}?"
    return f"; there are {', '.join(own.model_fields)}" if len(own.model_fields) <= MOST_NAMED else ""


@functools.cache
def keys_of(model: type[Section]) -> tuple[str, ...]:
    """Every key of a schema, and those that are rewritten before it is asked."""
    return (*(row.key for row in describe(model)), *model.rewritten)


def section_of(field: FieldInfo) -> type[Section] | None:
    """The Section inside a field's type (itself, optional or in a tuple), or None."""
    waiting = [field.annotation]
    while waiting:
        kind = waiting.pop()
        if isinstance(kind, type) and issubclass(kind, Section):
            return kind
        waiting += [inner for inner in typing.get_args(kind) if inner is not Ellipsis]
    return None


@dataclass(frozen=True, slots=True)
class Row:
    """One key of a schema for `show`."""

    key: str
    type: str
    unit: str
    default: str
    limits: str
    text: str


def describe(model: type[Section], prefix: str = "") -> list[Row]:
    """Every key of a schema in order, those of groups in lists as species[].charge."""
    rows = []
    for name, field in model.model_fields.items():
        inner = section_of(field)
        if inner:
            mark = "[]" if "tuple" in str(field.annotation) else ""
            rows += describe(inner, f"{prefix}{name}{mark}.")
            continue
        default = "required" if field.is_required() else value_text(field.default)
        kind, limits = type_words(field.annotation), limit_words(field)
        rows.append(Row(prefix + name, kind, unit_of(field), default, limits, field.description or ""))
    return rows


def unit_of(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def limit_words(field: FieldInfo) -> str:
    """The limits of a field, those of the elements of a vector included."""
    marks = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
    inner = typing.get_args(field.annotation)[:1] if typing.get_origin(field.annotation) is tuple else ()
    limits = [
        *field.metadata,
        *(
            limit
            for kind in inner
            if typing.get_origin(kind) is Annotated
            for info in typing.get_args(kind)[1:]
            for limit in getattr(info, "metadata", ())
        ),
    ]
    return ", ".join(
        f"{mark} {getattr(limit, name):g}" for limit in limits for name, mark in marks.items() if hasattr(limit, name)
    )


def type_words(annotation: Any) -> str:
    """A type as users call it."""
    words = {int: "integer", float: "number", str: "text", bool: "true|false", type(None): ""}
    if annotation in words:
        return words[annotation]
    arguments = typing.get_args(annotation)
    origin = typing.get_origin(annotation)
    if origin is typing.Literal:
        return "|".join(value_text(value) for value in arguments)
    if origin is tuple:
        inner = type_words(arguments[0])
        return f"({inner}, ..)" if "[" in inner else f"[{inner}, ..]"  # only lists hold lists
    if origin is Annotated:
        return type_words(arguments[0])
    return "|".join(filter(None, (type_words(argument) for argument in arguments)))
