// Start-up of an Arm MPS2 board and semihosting (Arm semihosting specification, version 2).
#include "board.hpp"

#include <cstddef>

int main();

extern "C" {
extern std::uint32_t stack_top;
extern std::uint32_t data_load;
extern std::uint32_t data_begin;
extern std::uint32_t data_end;
extern std::uint32_t bss_begin;
extern std::uint32_t bss_end;
using Initialiser = void (*)();
extern Initialiser init_array_begin;
extern Initialiser init_array_end;
}

namespace board {
namespace {

constexpr std::uint32_t kWrite0 = 0x04;
constexpr std::uint32_t kExit = 0x18;
constexpr std::uint32_t kApplicationExit = 0x20026;
constexpr std::uint32_t kRunTimeError = 0x20023;

void semihosting(std::uint32_t operation, std::uint32_t parameter) noexcept {
  register std::uint32_t r0 asm("r0") = operation;
  register std::uint32_t r1 asm("r1") = parameter;
  asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

volatile std::uint32_t& at(std::uint32_t address) noexcept {
  return *reinterpret_cast<volatile std::uint32_t*>(address);
}

}  // namespace

void print(const char* text) noexcept {
  semihosting(kWrite0, reinterpret_cast<std::uint32_t>(text));
}

void exit(int status) noexcept {
  semihosting(kExit, status == 0 ? kApplicationExit : kRunTimeError);
  for (;;) {
  }
}

void start_ticks() noexcept {
  at(0xE000E014) = kTicksMask;  // SYST_RVR
  at(0xE000E018) = 0;           // SYST_CVR
  at(0xE000E010) = 5;           // SYST_CSR: processor clock, no interrupt, on
}

}  // namespace board

extern "C" [[noreturn]] void reset() {
  board::at(0xE000ED88) = 0xFU << 20U;  // CPACR: the FPU on
  asm volatile("dsb\n\tisb" ::: "memory");
  const std::uint32_t* from = &data_load;
  for (std::uint32_t* to = &data_begin; to != &data_end;) *to++ = *from++;
  for (std::uint32_t* to = &bss_begin; to != &bss_end;) *to++ = 0;
  for (Initialiser* f = &init_array_begin; f != &init_array_end; ++f) (*f)();
  board::exit(main());
}

extern "C" [[noreturn]] void fault() {
  board::print("processor fault\n");
  board::exit(1);
}

namespace {
struct Vectors {
  std::uint32_t* stack;
  void (*handlers[15])();
};
}  // namespace
extern const Vectors vectors;
[[gnu::section(".vectors"), gnu::used]] const Vectors vectors = {
    &stack_top,
    {reset, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault,
     fault, fault}};
