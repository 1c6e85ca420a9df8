# SPDX-License-Identifier: Apache-2.0
"""Machine instructions that numba has no name for."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def or_if_above(_context, code, value, least, bit):
    """``code | bit`` where an int16 value is above the least, in 16 bits (numba's own operators
    widen to 64)."""

    def generate(_context, builder, _signature, args):
        code, value, least, bit = args
        above = builder.icmp_signed(">", value, least)
        return builder.or_(code, builder.select(above, bit, ir.Constant(ir.IntType(16), 0)))

    return types.uint16(types.uint16, types.int16, types.int16, types.uint16), generate


@intrinsic
def differing_bits(_context, a, b):
    """How many bits of two 32-bit codes differ, as float32."""

    def generate(_context, builder, _signature, args):
        return builder.uitofp(builder.ctpop(builder.xor(*args)), ir.FloatType())

    return types.float32(types.uint32, types.uint32), generate


@intrinsic
def quarters_that_differ(_context, a, b):
    """Four times how many bits of two 32-bit codes differ, as uint8."""

    def generate(_context, builder, _signature, args):
        count = builder.trunc(builder.ctpop(builder.xor(*args)), ir.IntType(8))
        return builder.shl(count, ir.Constant(ir.IntType(8), 2))

    return types.uint8(types.uint32, types.uint32), generate


@intrinsic
def whole_16(_context, value):
    """A float32 cut to int16, by way of 32 bits (numba's own goes by 64, which are not made into
    vector code)."""

    def generate(_context, builder, _signature, args):
        return builder.trunc(builder.fptosi(args[0], ir.IntType(32)), ir.IntType(16))

    return types.int16(types.float32), generate
