"""Any Python value as one canonical JSON text, and back.

Plain values are plain JSON: None, bool, int, finite float, str, list, and dict with str keys.
`np.bool_`, `np.int64`, `np.float64` and `np.str_` are written as these on purpose, so that an info
doesn't depend on int against `np.int64`. Everything else is an object whose "$" names its kind:

    {"$":"nan"}  inf  -inf                      floats that JSON doesn't know
    {"$":"int","v":"0x1f"}                      an int beyond 2,000 bits
    {"$":"str","v":base64}                      a surrogate pair that stands in two characters
    {"$":"tuple","v":[...]}  set  frozenset     sets in the order of their elements' texts
    {"$":"dict","v":[[key, value], ...]}        other keys, or a key "$"; in the order of the texts
    {"$":"bytes","v":base64}  bytearray  bytes_
    {"$":"complex","v":[re, im]}                and {"$":"range","v":[start, stop, step]}
    {"$":"float32","v":0.5}  int8  complex64    numpy scalars by the name of their dtype
    {"$":"scalar","v":<ndarray>}                ... whose dtype isn't a plain number's
    {"$":"ndarray","dtype":"<f4","shape":[2],"v":[1.0,2.0]}     base64 beyond 64 elements
    {"$":"record","shape":[2],"v":[["x", <ndarray>], ...]}      structured arrays by field
    {"$":"GraphInstance","v":[nodes, edges, edge_links]}
    {"$":"object","repr":"...","type":"module.Class"}           anything else, addresses scrubbed
    {"$":"object","type":"module.Class","v":...}                ... whose content is known

Equal values of equal types have equal texts in every process and under every hash seed; there is
one NaN, -0.0 is kept, arrays are little-endian. For builtins and numpy `from_json(to_json(x))`
equals x; for every text t that `to_json` wrote `to_json(from_json(t)) == t`.
"""

from collections.abc import Collection, Mapping

from gamekeeper.episodes.canonical.json_values import from_json, to_json
from gamekeeper.episodes.canonical.opaque import Opaque, shown, type_name

__all__ = ["Opaque", "drop", "from_json", "is_exact", "shown", "to_json", "type_name", "without"]


def is_exact(text: str) -> bool:
    """True if `from_json` gives back all of the value that this canonical text was written from."""
    return '"$":"object"' not in text  # within a JSON string these quotes would have backslashes


def drop(info: Mapping[str, object], names: Collection[str]) -> dict[str, object]:
    """The info without the fields of these names."""
    return {key: value for key, value in info.items() if key not in names}


def without(info: str | None, names: Collection[str]) -> str | None:
    """The canonical JSON of an info without the fields of these names; others stay as they are."""
    if info is None or not names:
        return info
    value = from_json(info)
    return to_json(drop(value, names)) if isinstance(value, dict) else info
