"""The float form of an int8 trunk: the same weights, and nothing between them is rounded.

Engines round int8 activations at different places, and no two agree to the bit. In float they do,
nearly: what it takes for results that have to be the same elsewhere.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from entrack.errors import require


def dequantise(path: Path) -> bytes:
    """Read a `trunk.onnx`; a quantised one becomes float, and its ranges from zero on ReLUs."""
    content = path.read_bytes()
    if b"QuantizeLinear" not in content:
        return content
    onnx: Any = require("onnx", "train")
    model = onnx.load(str(path))
    graph = model.graph
    makers = {name: node for node in graph.node for name in node.output}
    values = {c.name: onnx.numpy_helper.to_array(c) for c in graph.initializer}
    nodes: list[Any] = []
    for node in graph.node:
        if node.op_type == "QuantizeLinear":
            continue
        if node.op_type != "DequantizeLinear":
            nodes.append(node)
            continue
        source, scale, zero = node.input
        if source in values:
            axis = next((a.i for a in node.attribute if a.name == "axis"), 1)
            weights = _restored(values[source], values[scale], values[zero], axis)
            graph.initializer.append(onnx.numpy_helper.from_array(weights, node.output[0]))
        else:
            # The quantiser leaves out a ReLU whose range says the same.
            lowest = values[zero] == np.iinfo(values[zero].dtype).min
            kind = "Relu" if lowest else "Identity"
            nodes.append(onnx.helper.make_node(kind, [makers[source].input[0]], node.output))
    del graph.node[:]
    graph.node.extend(nodes)
    used = {name for node in graph.node for name in node.input}
    for constant in [c for c in graph.initializer if c.name not in used]:
        graph.initializer.remove(constant)
    del graph.value_info[:]
    for names in [part for node in graph.node for part in (node.input, node.output)]:
        names[:] = [name.replace("QuantizeLinear", "Float") for name in names]  # or it looks int8
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _restored(
    values: NDArray[Any], scale: NDArray[Any], zero: NDArray[Any], axis: int
) -> NDArray[np.float32]:
    """What DequantizeLinear makes of constants."""
    along = [-1 if k == axis else 1 for k in range(values.ndim)] if scale.size > 1 else []
    scale, zero = scale.reshape(along), zero.reshape(along)
    return ((values.astype(np.float64) - zero) * scale).astype(np.float32)
