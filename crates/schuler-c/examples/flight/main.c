/* A flight program around the module: configured from a block, a step for each input, and a power cycle in the middle.
 *
 * The same file runs on a PC and on the board. It reads and writes files where a flight computer has flash, sensors and telemetry:
 *
 *   configuration.bin  the configuration block          compensation.bin  the compensation block
 *   inputs.bin         SchulerInput, one after another  outputs.bin       SchulerOutput, one after another
 *
 * and blocks that cannot be flown, to show what is said of them: refused_nan.bin, refused_range.bin, newer.bin, nonsense.bin; other.bin
 * can be flown, and is another one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "schuler.h"

/* In statics: there is no heap, and the stack is small. */
static SchulerModule module;
static uint8_t block[4096];
static uint8_t state[49152];
static uint8_t other_state[sizeof state];

/* Ends the program where something is not as it must be. Flight software has better things to do. */
static void expect(int good, const char *what)
{
    if (!good) {
        printf("FAILED: %s\n", what);
        exit(1);
    }
}

static size_t read_file(const char *name, uint8_t *bytes, size_t capacity)
{
    FILE *file = fopen(name, "rb");
    expect(file != NULL, name);
    size_t length = fread(bytes, 1, capacity, file);
    fclose(file);
    return length;
}

/* What is done after every start of the processor. */
static void start(void)
{
    expect(schuler_init(&module, sizeof module, SCHULER_INTERFACE_VERSION) == SCHULER_RESULT_OK, "schuler_init");

    size_t length = read_file("configuration.bin", block, sizeof block);
    SchulerResult result = schuler_configure(&module, block, length);
    if (result != SCHULER_RESULT_OK) {
        char why[128];
        schuler_refusal(&module, why, sizeof why);
        printf("schuler_configure: %u %s\n", (unsigned)result, why);
        exit(1);
    }
}

/* What the ground has found out of the sensors. A saved state brings it back. */
static void correct(void)
{
    size_t length = read_file("compensation.bin", block, sizeof block);
    expect(schuler_load_compensation(&module, block, length) == SCHULER_RESULT_OK, "schuler_load_compensation");
}

/* Power is lost and comes back: everything is forgotten but the state that was saved. */
static void power_cycle(void)
{
    size_t length = 0;
    expect(schuler_save(&module, state, sizeof state, &length) == SCHULER_RESULT_OK, "schuler_save");
    memset(&module, 0xa5, sizeof module);
    start();
    expect(schuler_restore(&module, state, length) == SCHULER_RESULT_OK, "schuler_restore");
}

/* A block of the file is answered with this result. */
static void expect_configure(const char *name, SchulerResult result)
{
    size_t length = read_file(name, block, sizeof block);
    expect(schuler_configure(&module, block, length) == result, name);
}

/* A value that cannot be flown is named: "velocity_range: must be finite". */
static void expect_refusal(const char *name, const char *field)
{
    char why[128];
    expect_configure(name, SCHULER_RESULT_REFUSED);
    expect(schuler_refusal(&module, why, sizeof why) == SCHULER_RESULT_OK, "schuler_refusal");
    printf("%s: %s\n", name, why);
    expect(strncmp(why, field, strlen(field)) == 0, "the field that was refused");
}

/* Configurations and states that are damaged, or not what they should be. */
static void provoke_with_bytes(void)
{
    size_t length, other_length;
    expect_refusal("refused_nan.bin", "velocity_range: ");
    expect_refusal("refused_range.bin", "filter.gravity: ");
    expect_configure("newer.bin", SCHULER_RESULT_VERSION);
    expect_configure("nonsense.bin", SCHULER_RESULT_CONTENT);
    expect_configure("compensation.bin", SCHULER_RESULT_FORM);
    expect(schuler_state_length(&module, &length) == SCHULER_RESULT_NOT_CONFIGURED, "none of them was taken");

    /* The state of a module with another configuration. */
    expect_configure("other.bin", SCHULER_RESULT_OK);
    expect(schuler_save(&module, other_state, sizeof other_state, &other_length) == SCHULER_RESULT_OK, "schuler_save");
    start();
    expect(schuler_restore(&module, other_state, other_length) == SCHULER_RESULT_OTHER_CONFIGURATION, "a foreign state");

    expect(schuler_state_length(&module, &length) == SCHULER_RESULT_OK, "schuler_state_length");
    expect(schuler_save(&module, state, length - 1, &other_length) == SCHULER_RESULT_ROOM, "too little room");
    expect(schuler_save(&module, state, sizeof state, &length) == SCHULER_RESULT_OK, "schuler_save");
    expect(schuler_restore(&module, state, length - 1) == SCHULER_RESULT_FORM, "a state cut short");
    expect(schuler_restore(&module, state, length + 1) == SCHULER_RESULT_FORM, "something behind the state");
    expect(schuler_restore(&module, block, sizeof block) == SCHULER_RESULT_FORM, "no state at all");
    expect(schuler_restore(&module, NULL, length) == SCHULER_RESULT_NULL_POINTER, "null");
    state[length / 2] ^= 0x10;
    expect(schuler_restore(&module, state, length) == SCHULER_RESULT_CHECKSUM, "a flipped bit");
    state[length / 2] ^= 0x10;

    /* The module is as it was before all that. */
    expect(schuler_save(&module, other_state, sizeof other_state, &other_length) == SCHULER_RESULT_OK, "schuler_save");
    expect(other_length == length && memcmp(state, other_state, length) == 0, "what is refused changes nothing");
    expect(schuler_restore(&module, state, length) == SCHULER_RESULT_OK, "schuler_restore");
}

/* What the library refuses, it refuses without harm. */
static void provoke(void)
{
    SchulerInput input = {0};
    SchulerOutput output;
    size_t length;
    memset(&module, 0xa5, sizeof module);
    expect(schuler_step(&module, &input, &output) == SCHULER_RESULT_NOT_INITIALISED, "no schuler_init");
    expect(schuler_init(&module, sizeof module - 1, SCHULER_INTERFACE_VERSION) == SCHULER_RESULT_SIZE, "size");
    expect(schuler_init(&module, sizeof module, SCHULER_INTERFACE_VERSION + 1) == SCHULER_RESULT_INTERFACE_VERSION, "version");
    expect(schuler_init((SchulerModule *)((char *)&module + 1), sizeof module, SCHULER_INTERFACE_VERSION) ==
               SCHULER_RESULT_MISALIGNED, "misaligned");
    expect(schuler_init(&module, sizeof module, SCHULER_INTERFACE_VERSION) == SCHULER_RESULT_OK, "schuler_init");
    expect(schuler_step(&module, &input, &output) == SCHULER_RESULT_NOT_CONFIGURED, "no configuration");
    expect(output.status == SCHULER_STATUS_NOT_CONFIGURED, "the output says so");
    expect(schuler_save(&module, state, sizeof state, &length) == SCHULER_RESULT_NOT_CONFIGURED, "nothing to save");
    expect(schuler_configure(&module, NULL, 0) == SCHULER_RESULT_NULL_POINTER, "null");
    size_t read = read_file("configuration.bin", block, sizeof block);
    block[read / 2] ^= 1;
    expect(schuler_configure(&module, block, read) == SCHULER_RESULT_CHECKSUM, "a flipped bit");
    expect(schuler_configure(&module, block, read - 1) == SCHULER_RESULT_FORM, "cut short");
    provoke_with_bytes();
}

int main(void)
{
    provoke();
    start();
    correct();

    FILE *inputs = fopen("inputs.bin", "rb");
    FILE *outputs = fopen("outputs.bin", "wb");
    expect(inputs != NULL && outputs != NULL, "inputs.bin and outputs.bin");
    expect(fseek(inputs, 0, SEEK_END) == 0, "inputs.bin");
    long steps = ftell(inputs) / (long)sizeof(SchulerInput);
    rewind(inputs);

    for (long step = 0; step < steps; step++) {
        SchulerInput input;
        SchulerOutput output;
        expect(fread(&input, sizeof input, 1, inputs) == 1, "inputs.bin");
        if (step == steps / 2)
            power_cycle();
        expect(schuler_step(&module, &input, &output) == SCHULER_RESULT_OK, "schuler_step");
        expect(fwrite(&output, sizeof output, 1, outputs) == 1, "outputs.bin");
    }
    expect(fclose(outputs) == 0, "outputs.bin");
    printf("schuler %s: %ld steps\n", schuler_version(), steps);
    return 0;
}
