@ Bytes from one place to another that may overlap, by the names under which the compiler calls it (Arm's run-time ABI, IHI 0043).
@
@ A value that is kept or replaced without a branch is copied onto itself or onto another, as a whole: that takes the same number of
@ instructions either way. There is no other use in the image, so that bytes that move up over themselves may take their time.
@
@ The ABI allows `__aeabi_memcpy` no overlap. The one that is linked, of Rust's compiler_builtins, copies from the first byte on and
@ reads before it writes; the image `double` tries all distances and lengths.

        .syntax unified
        .thumb

@ Defines the function `name`, which calls `copy` where no byte would be overwritten before it has been read.
        .macro  move name, copy
        .section .text.\name, "ax", %progbits
        .p2align 1
        .global \name
        .type   \name, %function
        .thumb_func
\name:
        @ To the same place, down, or beyond the end: from the first byte on.
        subs    r3, r0, r1
        it      ne
        cmpne   r3, r2
        blo     1f
        b.w     \copy
        @ Up by less than the length: from the last byte on.
1:      subs    r2, r2, #1
        ldrb    r3, [r1, r2]
        strb    r3, [r0, r2]
        bne     1b
        bx      lr
        .endm

        move    __aeabi_memmove, __aeabi_memcpy
        move    __aeabi_memmove4, __aeabi_memcpy4
        move    __aeabi_memmove8, __aeabi_memcpy8
