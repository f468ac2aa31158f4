@ Double precision on a processor without it, by the names under which the compiler calls it (Arm's run-time ABI, IHI 0043).
@
@ Every function takes the same number of instructions whatever its operands: what depends on them is chosen by an
@ instruction that is passed over (IT) or by a shift, never by a branch. The only branches are those to infinities, NaN and a
@ difference of zero, where next to nothing is left to do; there `idle` makes up the rest.
@
@ IEEE 754, to nearest, ties to even, with subnormals. A result that is no number is a quiet NaN of either sign.
@
@ Operands and results stand in r1:r0 and r3:r2, the lower word first, as does every number of several words here (a:b is
@ a 2^32 + b). Exponents are counted from that of subnormals and of the smallest normal numbers, so both have 0; then
@ (exponent << 20) + significand is the number's upper word, the significand's leading bit adding the one that the field has
@ more.

        .syntax unified
        .thumb

        .macro  function name
        .section .text.\name, "ax", %progbits
        .p2align 2
        .global \name
        .type   \name, %function
        .thumb_func
\name:
        .endm

@ Takes `count` instructions and does nothing. Changes r12 and the flags.
        .macro  idle count
        mov     r12, #(\count - 1) / 2
8:      subs    r12, r12, #1
        bne     8b
        .if     (\count & 1) == 0
        nop
        .endif
        .endm

@ Carry set where x is a NaN; `infinity` holds 2047, `magnitude` is x's upper word without its sign, shifted left by one.
        .macro  is_nan magnitude, low, infinity, scratch
        cmp     \low, #1
        sbcs    \scratch, \magnitude, \infinity, lsl #21
        .endm

@ x - y and x + y.
        function __aeabi_dsub
        eor     r3, r3, #0x80000000
        .global __aeabi_dadd
        .type   __aeabi_dadd, %function
        .thumb_func
__aeabi_dadd:
        push    {r4-r8, lr}
        @ From here on |x| >= |y|.
        lsl     r12, r1, #1
        cmp     r0, r2
        sbcs    r12, r12, r3, lsl #1
        itttt   lo
        movlo   r4, r0
        movlo   r0, r2
        movlo   r2, r4
        movlo   r4, r1
        itt     lo
        movlo   r1, r3
        movlo   r3, r4
        ubfx    r4, r1, #20, #11
        ubfx    r5, r3, #20, #11
        movw    r12, #2047
        cmp     r4, r12
        beq     .Lsum_not_finite
        @ Exponents, r4 and how far y is to be shifted: r5.
        usat    r12, #1, r4
        sub     r4, r4, r12
        usat    r6, #1, r5
        sub     r5, r5, r6
        sub     r5, r4, r5
        usat    r5, #6, r5
        @ x from bit 61 on: r7:r0.
        lsl     r7, r1, #9
        orr     r7, r7, r0, lsr #23
        lsl     r0, r0, #9
        bfi     r7, r12, #29, #3
        @ y from bit 62 on, negative where the signs differ: r12:r3:r2.
        eor     lr, r1, r3
        lsl     r3, r3, #10
        orr     r3, r3, r2, lsr #22
        lsl     r2, r2, #10
        bfi     r3, r6, #30, #2
        eor     r2, r2, lr, asr #31
        eor     r3, r3, lr, asr #31
        subs    r2, r2, lr, asr #31
        sbc     r3, r3, lr, asr #31
        asr     r12, r3, #31
        @ Shifted right: by words, ...
        mov     r6, #0
        tst     r5, #32
        ittt    ne
        movne   r6, r2
        movne   r2, r3
        movne   r3, r12
        @ ... and by bits, and one more, as a product with 2^(31 - bits), which is added to x at once. To the product an r3:r2
        @ below zero is 2^64 more than it is. What is shifted out counts as one bit at the end.
        mov     r8, #0x80000000
        ror     r8, r8, r5
        umull   r5, r2, r2, r8
        adds    r0, r0, r2
        adc     r7, r7, #0
        umlal   r0, r7, r3, r8
        mla     r7, r12, r8, r7
        orrs    r5, r5, r6
        it      ne
        orrne   r0, r0, #1
        orrs    r2, r0, r7
        beq     .Lsum_zero
        @ Normalised: the leading bit to bit 63, or as far as the exponent goes.
        clz     r2, r7
        clz     r3, r0
        cmp     r2, #32
        it      eq
        addeq   r2, r2, r3
        add     r4, r4, #2
        cmp     r2, r4
        it      hi
        movhi   r2, r4
        sub     r4, r4, r2
        rsb     r3, r2, #32
        sub     r5, r2, #32
        lsl     r7, r7, r2
        lsr     r3, r0, r3
        orr     r7, r7, r3
        lsl     r5, r0, r5
        orr     r7, r7, r5
        lsl     r0, r0, r2
        @ Rounded to 53 bits.
        lsl     r2, r0, #21
        lsr     r0, r0, #11
        orr     r0, r0, r7, lsl #21
        lsr     r7, r7, #11
        add     r7, r7, r4, lsl #20
        cmp     r2, #0x80000000
        it      eq
        lsrseq  r3, r0, #1
        adcs    r0, r0, #0
        adc     r7, r7, #0
        @ Too large: infinity.
        adds    r2, r7, #0x100000
        itt     mi
        movmi   r0, #0
        bfcmi   r7, #0, #20
        bfi     r1, r7, #0, #31
        pop     {r4-r8, pc}

@ The sum of two zeros has their sign if they agree, any other is positive.
.Lsum_zero:
        bic     r1, r1, lr
        and     r1, r1, #0x80000000
        idle    31
        pop     {r4-r8, pc}

@ x, the larger, is infinite or a NaN: so is the sum. Two infinities of different sign make a NaN.
.Lsum_not_finite:
        mov     r6, #0
        cmp     r5, r12
        it      eq
        eoreq   r6, r1, r3
        lsr     r6, r6, #31
        orr     r6, r6, r0
        orrs    r6, r6, r1, lsl #12
        mov     r0, #0
        itt     ne
        movne   r1, #0
        movtne  r1, #0x7ff8
        idle    60
        pop     {r4-r8, pc}

@ x y.
        function __aeabi_dmul
        push    {r4-r8, lr}
        ubfx    r4, r1, #20, #11
        ubfx    r5, r3, #20, #11
        movw    r12, #2047
        cmp     r4, r12
        it      ne
        cmpne   r5, r12
        beq     .Lproduct_not_finite
        usat    r6, #1, r4
        usat    r7, #1, r5
        sub     r4, r4, r6
        sub     r5, r5, r7
        add     r4, r4, r5
        @ x from bit 62 on, y from bit 63 on: r8:r0 and r3:r2; r1 keeps the sign.
        lsl     r8, r1, #10
        orr     r8, r8, r0, lsr #22
        lsl     r0, r0, #10
        bfi     r8, r6, #30, #2
        eor     r1, r1, r3
        lsl     r3, r3, #11
        orr     r3, r3, r2, lsr #21
        lsl     r2, r2, #11
        bfi     r3, r7, #31, #1
        @ r12:r7:r6:r5 = r8:r0 r3:r2.
        umull   r5, r6, r0, r2
        mov     r7, #0
        umlal   r6, r7, r8, r2
        mov     r12, #0
        umaal   r6, r12, r0, r3
        umaal   r7, r12, r8, r3
        sub     r4, r4, #1020

@ The number r12:r7:r6:r5 2^(r4 - 1149), with the sign of r1. A quotient ends here too.
.Lproduct:
        @ Exponent of the result, r2, and how far the bits are to be shifted to stand where they belong, less one: r4.
        clz     r2, r12
        clz     r3, r7
        cmp     r2, #32
        it      eq
        addeq   r2, r2, r3
        sub     r2, r4, r2
        usat    r2, #12, r2
        sub     r4, r2, r4
        add     r4, r4, #74
        usat    r4, #7, r4
        @ Shifted right: by two words, by one, ...
        mov     r3, #0
        lsls    r0, r4, #26
        itttt   cs
        orrcs   r3, r5, r6
        movcs   r5, r7
        movcs   r6, r12
        movcs   r7, #0
        it      cs
        movcs   r12, #0
        itttt   mi
        orrmi   r3, r3, r5
        movmi   r5, r6
        movmi   r6, r7
        movmi   r7, r12
        @ ... and by bits, to r8:r5. What is shifted out is in r4, and a bit at its end for all that is below.
        mov     r0, #0x80000000
        ror     r0, r0, r4
        umull   r4, r5, r5, r0
        mov     r8, #0
        umlal   r5, r8, r6, r0
        mla     r8, r7, r0, r8
        cmp     r3, #0
        it      ne
        orrne   r4, r4, #1
        @ Zero has exponent 0.
        orrs    r3, r5, r8
        it      eq
        moveq   r2, #0
        @ Put together and rounded.
        add     r8, r8, r2, lsl #20
        cmp     r4, #0x80000000
        it      eq
        lsrseq  r3, r5, #1
        adcs    r0, r5, #0
        adc     r8, r8, #0
        @ Too large: infinity.
        adds    r2, r8, #0x100000
        ittt    mi
        movmi   r0, #0
        movmi   r8, #0
        movtmi  r8, #0x7ff0
        bfi     r1, r8, #0, #31
        pop     {r4-r8, pc}

@ One at least is infinite or a NaN. So is the product; infinity times zero is a NaN.
.Lproduct_not_finite:
        eor     r6, r1, r3
        lsl     r1, r1, #1
        lsl     r3, r3, #1
        mov     r5, #0
        movt    r5, #0x7ff0
        is_nan  r1, r0, r12, r7
        it      cs
        orrcs   r5, r5, #0x80000
        is_nan  r3, r2, r12, r7
        it      cs
        orrcs   r5, r5, #0x80000
        orrs    r4, r0, r1
        it      ne
        orrsne  r4, r2, r3
        it      eq
        orreq   r5, r5, #0x80000
        mov     r0, #0
        and     r1, r6, #0x80000000
        orr     r1, r1, r5
        idle    48
        pop     {r4-r8, pc}

@ Shifts high:low left until its leading bit is bit 63; by how much: r5. Changes r7 and r8.
        .macro  normalise high, low
        clz     r5, \high
        clz     r7, \low
        cmp     r5, #32
        it      eq
        addeq   r5, r5, r7
        rsb     r7, r5, #32
        sub     r8, r5, #32
        lsl     \high, \high, r5
        lsr     r7, \low, r7
        orr     \high, \high, r7
        lsl     r8, \low, r8
        orr     \high, \high, r8
        lsl     \low, \low, r5
        .endm

@ x/y.
        .global __aeabi_ddiv
        .type   __aeabi_ddiv, %function
        .thumb_func
__aeabi_ddiv:
        push    {r4-r8, lr}
        ubfx    r4, r1, #20, #11
        ubfx    r5, r3, #20, #11
        movw    r12, #2047
        cmp     r4, r12
        ittt    ne
        cmpne   r5, r12
        orrsne  r6, r0, r1, lsl #1
        orrsne  r6, r2, r3, lsl #1
        beq     .Lquotient_not_finite
        usat    r6, #1, r4
        usat    r7, #1, r5
        sub     r4, r4, r6
        sub     r5, r5, r7
        sub     r4, r4, r5
        eor     lr, r1, r3
        @ Significands from bit 63 on, a in r1:r0, b in r3:r2.
        bfi     r1, r6, #20, #12
        bfi     r3, r7, #20, #12
        normalise r1, r0
        sub     r4, r4, r5
        normalise r3, r2
        add     r4, r4, r5
        @ r6 = 2^95/b to 28 bits, never more: 17 bits by the processor's division, the rest by one step of Newton's.
        lsr     r5, r3, #16
        add     r5, r5, #1
        mvn     r6, #0
        udiv    r6, r6, r5
        umull   r5, r7, r3, r6
        lsl     r7, r7, #16
        orr     r7, r7, r5, lsr #16
        mvn     r7, r7
        lsl     r6, r6, #15
        umull   r5, r7, r6, r7
        add     r6, r6, r7
        sub     r6, r6, #2
        @ First digit of the quotient, r5 = 2^31 a/b, less than 14 too small.
        umull   r7, r5, r1, r6
        @ Both significands from bit 52 on.
        lsr     r0, r0, #11
        orr     r0, r0, r1, lsl #21
        lsr     r1, r1, #11
        lsr     r2, r2, #11
        orr     r2, r2, r3, lsl #21
        lsr     r3, r3, #11
        @ What is left, r12:r7 = 2^31 a - r5 b, below 2^57.
        umull   r7, r12, r5, r2
        mla     r12, r5, r3, r12
        lsr     r8, r0, #1
        orr     r8, r8, r1, lsl #31
        rsbs    r7, r7, r0, lsl #31
        sbc     r12, r8, r12
        @ Second digit, r7: now 2^58 a/b is 2^27 r5 + r7 and less than 7 more.
        lsl     r12, r12, #7
        orr     r12, r12, r7, lsr #25
        umull   r8, r7, r12, r6
        @ The quotient r5:r7 = 2^54 a/b, right or one too large.
        add     r7, r7, #7
        adds    r7, r7, r5, lsl #27
        lsr     r5, r5, #5
        adc     r5, r5, #0
        lsr     r7, r7, #4
        orr     r7, r7, r5, lsl #28
        lsr     r5, r5, #4
        @ The remainder, r12:r8 = 2^54 a - r5:r7 b, says which.
        umull   r8, r12, r7, r2
        mla     r12, r7, r3, r12
        mla     r12, r5, r2, r12
        rsbs    r8, r8, #0
        lsl     r0, r0, #22
        sbc     r12, r0, r12
        asr     r0, r12, #31
        and     r2, r2, r0
        and     r3, r3, r0
        adds    r8, r8, r2
        adc     r12, r12, r3
        adds    r7, r7, r0
        adc     r5, r5, r0
        @ Rounded, with the remainder below, as a product is.
        orr     r6, r8, r12
        mov     r12, r5
        mov     r5, #0
        mov     r1, lr
        addw    r4, r4, #1031
        b       .Lproduct

@ One at least is infinite, a NaN or zero.
.Lquotient_not_finite:
        eor     r6, r1, r3
        lsl     r1, r1, #1
        lsl     r3, r3, #1
        mov     r7, #0
        movt    r7, #0x7ff8
        @ Zero where x is zero or y infinite, infinity else.
        bic     r8, r7, #0x80000
        cmp     r5, r12
        it      ne
        orrsne  lr, r0, r1
        it      eq
        moveq   r8, #0
        @ A NaN where both are infinite, both zero, or one a NaN.
        cmp     r4, r12
        it      eq
        cmpeq   r5, r12
        it      eq
        moveq   r8, r7
        orr     r4, r0, r1
        orr     r4, r4, r2
        orrs    r4, r4, r3
        it      eq
        moveq   r8, r7
        is_nan  r1, r0, r12, r4
        it      cs
        movcs   r8, r7
        is_nan  r3, r2, r12, r4
        it      cs
        movcs   r8, r7
        mov     r0, #0
        and     r1, r6, #0x80000000
        orr     r1, r1, r8
        idle    106
        pop     {r4-r8, pc}

@ Order of x and y: r0 = 1 where x < y, r1 = 1 where x = y, r2 = 1 where neither is a NaN. Changes r4 to r6.
        function double_order
        movw    r12, #2047
        lsl     r4, r1, #1
        lsl     r5, r3, #1
        is_nan  r4, r0, r12, r6
        sbc     r6, r6, r6
        is_nan  r5, r2, r12, r12
        it      cs
        movcs   r6, #0
        @ As two's complements, in which both zeros are one.
        asr     r12, r1, #31
        eor     r0, r0, r12
        eor     r1, r12, r4, lsr #1
        subs    r0, r0, r12
        sbc     r1, r1, r12
        asr     r12, r3, #31
        eor     r2, r2, r12
        eor     r3, r12, r5, lsr #1
        subs    r2, r2, r12
        sbc     r3, r3, r12
        subs    r2, r0, r2
        sbcs    r3, r1, r3
        ite     lt
        movlt   r0, #1
        movge   r0, #0
        and     r0, r0, r6
        orr     r1, r2, r3
        clz     r1, r1
        and     r1, r6, r1, lsr #5
        and     r2, r6, #1
        bx      lr

        .macro  comparison name, operation:vararg
        function \name
        push    {r4-r6, lr}
        bl      double_order
        \operation
        pop     {r4-r6, pc}
        .endm

        comparison __aeabi_dcmplt, nop
        comparison __aeabi_dcmple, orr r0, r0, r1
        comparison __aeabi_dcmpeq, mov r0, r1
        comparison __aeabi_dcmpge, eor r0, r0, r2
        comparison __aeabi_dcmpun, eor r0, r2, #1
        function __aeabi_dcmpgt
        push    {r4-r6, lr}
        bl      double_order
        orr     r0, r0, r1
        eor     r0, r0, r2
        pop     {r4-r6, pc}

@ A float as a double.
        function __aeabi_f2d
        ubfx    r1, r0, #23, #8
        usat    r3, #1, r1
        sub     r2, r1, r3
        cmp     r1, #255
        it      eq
        addeq   r2, r2, #896
        ubfx    r1, r0, #0, #23
        orr     r1, r1, r3, lsl #23
        clz     r3, r1
        lsl     r1, r1, r3
        sub     r2, r2, r3
        add     r2, r2, #904
        cmp     r1, #0
        it      eq
        moveq   r2, #0
        lsl     r2, r2, #20
        add     r2, r2, r1, lsr #11
        and     r3, r0, #0x80000000
        lsl     r0, r1, #21
        orr     r1, r2, r3
        bx      lr

@ A double as the nearest float.
        function __aeabi_d2f
        push    {r4, lr}
        @ What is too large becomes infinity, or the NaN that it is: r4.
        movw    r12, #2047
        lsl     r3, r1, #1
        is_nan  r3, r0, r12, r3
        mov     r4, #0x7f800000
        it      cs
        orrcs   r4, r4, #0x400000
        @ Exponent, r12, and what the float's least exponent makes be shifted out: r2.
        ubfx    r2, r1, #20, #11
        subw    r2, r2, #897
        usat    r12, #8, r2
        sub     r2, r12, r2
        usat    r2, #5, r2
        @ Significand from bit 24 on: r3, and the rest of it.
        lsl     r3, r1, #4
        orr     r3, r3, r0, lsr #28
        bfc     r3, #24, #8
        orr     r3, r3, #0x1000000
        lsls    r0, r0, #4
        mov     r0, #0x80000000
        ror     r0, r0, r2
        umull   r2, r3, r3, r0
        it      ne
        orrne   r2, r2, #1
        add     r3, r3, r12, lsl #23
        cmp     r2, #0x80000000
        it      eq
        lsrseq  r0, r3, #1
        adc     r3, r3, #0
        adds    r0, r3, #0x800000
        it      mi
        movmi   r3, r4
        and     r0, r1, #0x80000000
        orr     r0, r0, r3
        pop     {r4, pc}

@ Whole numbers as doubles: with sign and without.
        function __aeabi_i2d
        and     r1, r0, #0x80000000
        eor     r0, r0, r0, asr #31
        add     r0, r0, r1, lsr #31
        b       .Lwhole
        .global __aeabi_ui2d
        .type   __aeabi_ui2d, %function
        .thumb_func
__aeabi_ui2d:
        mov     r1, #0
.Lwhole:
        clz     r2, r0
        lsl     r0, r0, r2
        movw    r3, #1053
        sub     r3, r3, r2
        cmp     r0, #0
        it      eq
        moveq   r3, #0
        add     r1, r1, r3, lsl #20
        add     r1, r1, r0, lsr #11
        lsl     r0, r0, #21
        bx      lr

@ A double towards zero as a whole number, with sign and without: what is out of range becomes the nearest, a NaN zero.
        function __aeabi_d2iz
        asr     r12, r1, #31
        bic     r1, r1, #0x80000000
        push    {r12, lr}
        bl      __aeabi_d2uiz
        pop     {r12, lr}
        mvn     r1, #0x80000000
        sub     r1, r1, r12
        cmp     r0, r1
        it      hi
        movhi   r0, r1
        eor     r0, r0, r12
        sub     r0, r0, r12
        bx      lr
        function __aeabi_d2uiz
        lsl     r3, r1, #11
        orr     r3, r3, r0, lsr #21
        orr     r3, r3, #0x80000000
        ubfx    r2, r1, #20, #11
        movw    r12, #1054
        subs    r2, r12, r2
        usat    r2, #6, r2
        lsr     r3, r3, r2
        it      mi
        movmi   r3, #-1
        bic     r3, r3, r1, asr #31
        movw    r12, #2047
        lsl     r1, r1, #1
        is_nan  r1, r0, r12, r1
        it      cs
        movcs   r3, #0
        mov     r0, r3
        bx      lr
