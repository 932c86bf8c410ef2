// The least of a board that counting needs: text out, exit status, an instruction clock.
#pragma once

#include <cstdint>

namespace board {

/// Writes to the debugger's console (Arm semihosting).
void print(const char* text) noexcept;

/// Ends the run; the status is that of the emulator.
[[noreturn]] void exit(int status) noexcept;

/// Processor clock at 25 MHz, counts down, 24 bits.
inline constexpr std::uint32_t kTicksMask = 0xFFFFFF;
inline constexpr std::uint32_t kTicks = 0xE000E018;  // SYST_CVR
void start_ticks() noexcept;
inline std::uint32_t ticks() noexcept { return *reinterpret_cast<volatile std::uint32_t*>(kTicks); }

}  // namespace board
