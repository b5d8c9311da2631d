"""YAML as camera files have it, read by PyYAML's safe loader with the rules of the programs that write it.

What differs from the safe loader: 1e-05 is a number (YAML 1.1 takes it for a text), yes, no, dates and 1:20 are texts,
010 is ten; `!!opencv-matrix` and its like are what they contain; a key twice, or a second document, is a mistake.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

MOST_VALUES = 1_000_000
"""Values a file may hold with every alias written out: a thousand times the largest camera file; aliases of aliases
are how a small file fills the memory."""


class YamlDocumentError(ValueError):
    """What is not understood; the text says on which line."""


def parse_yaml(text: str) -> Any:
    """Dicts, lists, floats, ints, bools, None and strings from `text`; raises YamlDocumentError with the line."""
    try:
        loader = _Loader(re.sub(r"^%YAML:1\.[0-9].*$", "", text, count=1, flags=re.MULTILINE))
        root = _only_document(loader)
        _refuse_blown_up(root)
        return loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        raise YamlDocumentError(_words(error)) from None
    except yaml.YAMLError as error:
        raise YamlDocumentError(str(error).splitlines()[0]) from None
    except RecursionError:
        raise YamlDocumentError("nested too deeply for a camera file") from None


def _words(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    begun = error.context_mark
    since = f" ({error.context} from line {begun.line + 1})" if begun is not None and error.context else ""
    return f"line {mark.line + 1 if mark is not None else '?'}: {error.problem}{since}"


def _only_document(loader: _Loader) -> yaml.Node:
    """The one document; empty ones after it (a closing `---`, as `ros2 topic echo` prints it) are none."""
    found: list[yaml.Node] = []
    while loader.check_node():
        node = loader.get_node()
        if node is not None:
            found.append(node)
    while found and _empty(found[-1]):
        found.pop()
    if not found:
        raise YamlDocumentError("nothing in the file")
    if len(found) > 1:
        line = found[1].start_mark.line + 1
        raise YamlDocumentError(f"line {line}: {len(found)} documents in one file, one was expected")
    return found[0]


def _empty(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null"


def _refuse_blown_up(root: yaml.Node) -> None:
    """Raises YamlDocumentError for a value within itself, or more than MOST_VALUES with aliases written out."""
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size(node: yaml.Node) -> int:
        key = id(node)
        if key in open_nodes:
            raise YamlDocumentError(f"line {node.start_mark.line + 1}: a value that contains itself")
        if key not in sizes:
            open_nodes.add(key)
            parts = node.value if isinstance(node, yaml.CollectionNode) else []
            flat = [n for part in parts for n in (part if isinstance(part, tuple) else (part,))]
            sizes[key] = 1 + sum(map(size, flat))
            open_nodes.remove(key)
        return sizes[key]

    if size(root) > MOST_VALUES:
        raise YamlDocumentError(f"more than {MOST_VALUES} values once its aliases are written out")


class _Loader(yaml.SafeLoader):
    """The safe loader with the resolvers and constructors below."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012  (PyYAML's way; `add_implicit_resolver` copies it)


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key, _ in node.value:
        name = loader.construct_object(key, deep=True)
        line = key.start_mark.line + 1
        if isinstance(name, list | dict):
            raise YamlDocumentError(f"line {line}: a key that is a list or a mapping")
        if name in seen:
            raise YamlDocumentError(f"line {line}: the key {name!r} twice")
        seen.add(name)
    return dict(loader.construct_pairs(node, deep=True))


def _tagged(loader: _Loader, _: str, node: yaml.Node) -> Any:
    """The value under a tag such as !!opencv-matrix, as if it had none."""
    if isinstance(node, yaml.MappingNode):
        return _mapping(loader, node)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)  # type: ignore[arg-type]


def _whole(loader: _Loader, node: yaml.ScalarNode) -> int:
    return int(str(loader.construct_scalar(node)))


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    return float(str(loader.construct_scalar(node)).lower().replace(".nan", "nan").replace(".inf", "inf"))


for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", "~nN"),
    ("int", r"[-+]?[0-9]+", "-+0123456789"),
    ("float", r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|Nan|NAN)",
     "-+0123456789."),
):  # fmt: skip
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), [*_first, *([""] if _tag == "null" else [])]
    )
_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _whole)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)
_Loader.add_multi_constructor("tag:yaml.org,2002:opencv", _tagged)
_Loader.add_multi_constructor("!", _tagged)
