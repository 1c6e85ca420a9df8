# SPDX-License-Identifier: Apache-2.0
"""Machine instructions that numba has no name for."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def or_if(_context, code, condition, bit):
    """``code | bit`` where the condition holds, in 32 bits (numba's own operators widen to 64)."""

    def generate(_context, builder, _signature, args):
        code, condition, bit = args
        flag = condition if condition.type == ir.IntType(1) else builder.trunc(condition, ir.IntType(1))
        return builder.or_(code, builder.select(flag, bit, ir.Constant(ir.IntType(32), 0)))

    return types.uint32(types.uint32, types.boolean, types.uint32), generate


@intrinsic
def differing_bits(_context, a, b):
    """How many bits of two 32-bit codes differ, as float32."""

    def generate(_context, builder, _signature, args):
        return builder.uitofp(builder.ctpop(builder.xor(*args)), ir.FloatType())

    return types.float32(types.uint32, types.uint32), generate
