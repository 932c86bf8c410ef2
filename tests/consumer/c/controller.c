/* A controller's firmware in C on an exported machine file. */
#include <stdio.h>

#include "machine.h" /* servosense export --c machine.ini --out machine.h */

static union {
  uint64_t align;
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
} storage __attribute__((aligned(16)));

int main(void) {
  servosense_stack* stack;
  const char* parameter;
  const char* fault =
      servosense_init(storage.bytes, sizeof storage.bytes, &machine, &stack, &parameter);
  if (fault != NULL) {
    printf("%s: %s\n", parameter, fault);
    return 1;
  }
  printf("%g\n", machine.axis[0].inertia);
  return servosense_version() == SERVOSENSE_CAPI_VERSION ? 0 : 1;
}
