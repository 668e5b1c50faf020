"""Sums of scaled 3x3 blocks inside kernels, eight of the nine numbers at once.

Compilers vectorise innermost loops only, and not one of nine rounds; so the sums are written as LLVM vector code.
Blocks are given by the addresses of their first numbers, nine numbers in a row [bytes: BLOCK_BYTES].
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

BLOCK_BYTES = 72
"""Size of a block [bytes]."""

_REAL = ir.DoubleType()
_EIGHT = ir.VectorType(_REAL, 8)
_LAST = 64  # [bytes] where the ninth number is


def _sum(adds: bool) -> Callable[..., Any]:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def at(place: Any, form: Any) -> Any:
            return builder.inttoptr(place, form.as_pointer())

        def fused(form: Any, name: str, a: Any, b: Any, c: Any) -> Any:
            of = ir.FunctionType(form, [form] * 3)
            return builder.call(cgutils.get_or_insert_function(builder.module, of, f"llvm.fma.{name}"), [a, b, c])

        target, (factors, sources) = arguments[0], (cgutils.unpack_tuple(builder, each) for each in arguments[1:])
        end = builder.add(target, ir.Constant(target.type, _LAST))
        eight = builder.load(at(target, _EIGHT), align=8) if adds else ir.Constant(_EIGHT, [0.0] * 8)
        ninth = builder.load(at(end, _REAL), align=8) if adds else ir.Constant(_REAL, 0.0)
        for factor, source in zip(factors, sources, strict=True):
            one = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), factor, ir.Constant(ir.IntType(32), 0))
            mask = ir.Constant(ir.VectorType(ir.IntType(32), 8), [0] * 8)
            every = builder.shuffle_vector(one, ir.Constant(_EIGHT, ir.Undefined), mask)
            last = builder.add(source, ir.Constant(source.type, _LAST))
            eight = fused(_EIGHT, "v8f64", every, builder.load(at(source, _EIGHT), align=8), eight)
            ninth = fused(_REAL, "f64", factor, builder.load(at(last, _REAL), align=8), ninth)
        builder.store(eight, at(target, _EIGHT), align=8)
        builder.store(ninth, at(end, _REAL), align=8)
        return context.get_dummy_value()

    return code


def _signature(target: Any, factors: Any, sources: Any) -> Any:
    count = len(factors)
    return types.void(types.int64, types.UniTuple(types.float64, count), types.UniTuple(types.int64, count))


def _add_blocks(typing, target, factors, sources):
    """C <- C + sum_k f_k A_k.

    Args:
        target: Address of C.
        factors: f_k, a tuple.
        sources: Addresses of A_k, a tuple.
    """
    return _signature(target, factors, sources), _sum(True)


def _put_blocks(typing, target, factors, sources):
    """C <- sum_k f_k A_k; arguments as in `add_blocks`."""
    return _signature(target, factors, sources), _sum(False)


add_blocks: Any = intrinsic(_add_blocks)
put_blocks: Any = intrinsic(_put_blocks)
