"""Arithmetic on sixteen doubles at once inside compiled kernels.

Loops over the columns of a block are too short for the compiler to turn them into vector
instructions reliably, so the block is one value here, a batch, with + - * / and comparisons,
which give masks. LLVM maps it to whatever vector registers the processor has. Every slot is
computed by ordinary IEEE arithmetic, in the order of the source.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic, models, overload, register_model

WIDTH = 16
"""Numbers in a batch."""

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)
_INLINE = {"forceinline": True}


class BatchType(types.Type):
    """Sixteen doubles."""

    def __init__(self) -> None:
        super().__init__(name="Batch")


class MaskType(types.Type):
    """Sixteen truth values."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


BATCH, MASK = BatchType(), MaskType()


@register_model(BatchType)
class _BatchModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


@intrinsic  # type: ignore[untyped-decorator]
def spread(typing: Any, number: Any) -> Any:
    """Return a batch with one number in all slots."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        wide = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), args[0], _index(0))
        return builder.shuffle_vector(wide, wide, _order([0] * WIDTH))

    return BATCH(types.float64), build


@intrinsic  # type: ignore[untyped-decorator]
def load(typing: Any, rows: Any, row: Any) -> Any:
    """Return one row of an (R, 16) array of doubles as a batch."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, signature, args), align=8)

    return BATCH(rows, types.intp), build


@intrinsic  # type: ignore[untyped-decorator]
def put(typing: Any, rows: Any, row: Any, batch: Any) -> Any:
    """Write a batch into one row of an (R, 16) array of doubles."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _place(context, builder, signature, args), align=8)
        return context.get_dummy_value()

    return types.void(rows, types.intp, BATCH), build


@intrinsic  # type: ignore[untyped-decorator]
def put_narrow(typing: Any, rows: Any, row: Any, place: Any, batch: Any) -> Any:
    """Write a batch into a row of an (R, C) array of float32 or int32, from column `place` on."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        whole = isinstance(signature.args[0].dtype, types.Integer)
        kind = ir.VectorType(ir.IntType(32) if whole else ir.FloatType(), WIDTH)
        value = builder.fptosi(args[3], kind) if whole else builder.fptrunc(args[3], kind)
        array = context.make_array(signature.args[0])(context, builder, value=args[0])
        length = builder.extract_value(array.shape, 1)
        offset = builder.add(builder.mul(args[1], length), args[2])
        pointer = builder.bitcast(builder.gep(array.data, [offset]), ir.PointerType(kind))
        builder.store(value, pointer, align=4)
        return context.get_dummy_value()

    return types.void(rows, types.intp, types.intp, BATCH), build


@intrinsic  # type: ignore[untyped-decorator]
def flip(typing: Any, batch: Any) -> Any:
    """Return the batch in reverse order."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.shuffle_vector(args[0], args[0], _order(list(range(WIDTH))[::-1]))

    return BATCH(BATCH), build


@intrinsic  # type: ignore[untyped-decorator]
def pick(typing: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the mask is true and `no` elsewhere."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(*args)

    return BATCH(MASK, BATCH, BATCH), build


@intrinsic  # type: ignore[untyped-decorator]
def root(typing: Any, batch: Any) -> Any:
    """Return square roots."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        name = f"llvm.sqrt.v{WIDTH}f64"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return BATCH(BATCH), build


@intrinsic  # type: ignore[untyped-decorator]
def count(typing: Any, mask: Any) -> Any:
    """Return the number of slots where the mask is true."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.zext(builder.ctpop(word), ir.IntType(64))

    return types.int64(MASK), build


@intrinsic  # type: ignore[untyped-decorator]
def least(typing: Any, batch: Any) -> Any:
    """Return the least number of a batch without NaN."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        value, half = args[0], WIDTH // 2
        while half:
            other = builder.shuffle_vector(
                value, value, _order([(slot + half) % WIDTH for slot in range(WIDTH)])
            )
            value = builder.select(builder.fcmp_ordered("<", value, other), value, other)
            half //= 2
        return builder.extract_element(value, _index(0))

    return types.float64(BATCH), build


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    rows = context.make_array(signature.args[0])(context, builder, value=args[0])
    offset = builder.mul(args[1], ir.Constant(args[1].type, WIDTH))
    return builder.bitcast(builder.gep(rows.data, [offset]), ir.PointerType(_VECTOR))


def _index(slot: int) -> Any:
    return ir.Constant(ir.IntType(32), slot)


def _order(batch: list[int]) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), batch)


def _define(symbol: Callable[..., Any], kind: Any, result: Any, emit: Callable[..., Any]) -> None:
    """Define an operator for two values of the kind, or for one and a number."""

    @intrinsic  # type: ignore[untyped-decorator]
    def both(typing: Any, a: Any, b: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return emit(builder, *args)

        return result(kind, kind), build

    # Numba compares these argument lists with those of the lambdas, annotations included.
    @overload(symbol, jit_options=_INLINE)
    def choose(a, b):  # type: ignore[no-untyped-def]
        if a == kind and b == kind:
            return lambda a, b: both(a, b)
        if a == BATCH == kind and isinstance(b, types.Float):
            return lambda a, b: both(a, spread(b))
        if b == BATCH == kind and isinstance(a, types.Float):
            return lambda a, b: both(spread(a), b)
        return None


_define(operator.add, BATCH, BATCH, lambda builder, a, b: builder.fadd(a, b))
_define(operator.sub, BATCH, BATCH, lambda builder, a, b: builder.fsub(a, b))
_define(operator.mul, BATCH, BATCH, lambda builder, a, b: builder.fmul(a, b))
_define(operator.truediv, BATCH, BATCH, lambda builder, a, b: builder.fdiv(a, b))
_define(operator.lt, BATCH, MASK, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define(operator.le, BATCH, MASK, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_define(operator.gt, BATCH, MASK, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_define(operator.ge, BATCH, MASK, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
_define(operator.eq, BATCH, MASK, lambda builder, a, b: builder.fcmp_ordered("==", a, b))
_define(operator.and_, MASK, MASK, lambda builder, a, b: builder.and_(a, b))
