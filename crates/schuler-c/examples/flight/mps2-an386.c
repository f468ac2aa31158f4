/* Start-up for Arm MPS2 with image AN386 (Cortex-M4F), as emulated by QEMU: the vectors, the floating-point unit, data and
 * bss; files and the end of the program through semihosting, by newlib's librdimon. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define COPROCESSORS_10_AND_11 (0xFu << 20)

extern uint32_t stack_start[], data_begin[], data_end[], data_load[], bss_begin[], bss_end[];

int main(void);
void initialise_monitor_handles(void);

static void fault(void)
{
    /* Semihosting SYS_EXIT with ADP_Stopped_RunTimeErrorUnknown: QEMU ends with an error. */
    register uint32_t operation __asm__("r0") = 0x18;
    register uint32_t reason __asm__("r1") = 0x20023;
    __asm__ volatile("bkpt 0xab" : : "r"(operation), "r"(reason) : "memory");
    for (;;) {
    }
}

void reset(void)
{
    /* Nothing may touch a floating-point register before this. */
    CPACR |= COPROCESSORS_10_AND_11;
    __asm__ volatile("dsb\n isb" : : : "memory");
    memcpy(data_begin, data_load, (size_t)((char *)data_end - (char *)data_begin));
    memset(bss_begin, 0, (size_t)((char *)bss_end - (char *)bss_begin));
    initialise_monitor_handles();
    exit(main());
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} vectors = {stack_start, {reset, fault, fault, fault, fault, fault}};

/* Newlib calls these for constructors and destructors, of which C has none. */
void _init(void) {}
void _fini(void) {}
