// Counts the instructions of every block on every sample and prints `block,core,mean,worst`.
//
// QEMU runs with `-icount shift=8`: one instruction takes 256 ns of the machine's time, that is 6.4
// ticks of its 25 MHz clock, so the difference of two readings tells the exact number of
// instructions between them. The empty block's are subtracted.
#include "block_table.hpp"
#include "board.hpp"

namespace {

using bench::TableEntry;

constexpr std::uint32_t kInstruction_ns = 256;
constexpr std::uint32_t kTick_ns = 40;
constexpr std::uint32_t kSamples = 8192;

bench::Sample<float> samples[kSamples];
volatile float sink;

std::uint32_t instructions(std::uint32_t before, std::uint32_t after) noexcept {
  const std::uint32_t ticks = (before - after) & board::kTicksMask;
  return (ticks * kTick_ns + kInstruction_ns / 2) / kInstruction_ns;
}

// The same code for every block, so that all but the block itself cancels.
[[gnu::noinline]] std::uint32_t count(const TableEntry& entry, const bench::Sample<float>& in) {
  const std::uint32_t before = board::ticks();
  sink = entry.step(entry.block, in);
  return instructions(before, board::ticks());
}

void print_number(std::uint64_t value) noexcept {
  char digits[21] = {};
  char* at = digits + 20;
  do {
    *--at = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  board::print(at);
}

struct Cost {
  std::uint64_t sum = 0;
  std::uint32_t worst = 0;
};

Cost measure(const TableEntry& entry) {
  Cost cost;
  for (const bench::Sample<float>& sample : samples) {
    const std::uint32_t n = count(entry, sample);
    cost.sum += n;
    if (n > cost.worst) cost.worst = n;
  }
  return cost;
}

// A stretch of known length: the clock must resolve single instructions.
bool clock_is_exact() {
  std::uint32_t start = 0;
  std::uint32_t one = 0;
  std::uint32_t thousand = 0;
  asm volatile(
      "ldr %0, [%3]\n\t"
      "ldr %1, [%3]\n\t"
      ".rept 999\n\tnop\n\t.endr\n\t"
      "ldr %2, [%3]"
      : "=&r"(start), "=&r"(one), "=&r"(thousand)
      : "r"(board::kTicks));
  return instructions(start, one) == 1 && instructions(one, thousand) == 1000;
}

}  // namespace

int main() {
  board::start_ticks();
  if (!clock_is_exact()) {
    board::print("the clock does not resolve single instructions (needs -icount shift=8)\n");
    return 1;
  }
  bench::CutSignal<float> signal(kSamples, true);
  for (bench::Sample<float>& sample : samples) sample = signal.next();

  Cost empty;
  for (const TableEntry& entry : bench::block_table()) {
    if (const servosense::Status status = entry.configure(entry.block); !status.ok()) {
      board::print(entry.name);
      board::print(": configuration refused, ");
      board::print(status.parameter());
      board::print("\n");
      return 1;
    }
    const Cost cost = measure(entry);
    if (&entry == &bench::block_table().front()) {
      empty = cost;
      continue;
    }
    const std::uint64_t tenths = ((cost.sum - empty.sum) * 10 + kSamples / 2) / kSamples;
    board::print(entry.name);
    board::print("," SERVOSENSE_CORE ",");
    print_number(tenths / 10);
    board::print(".");
    print_number(tenths % 10);
    board::print(",");
    print_number(cost.worst - empty.worst);
    board::print("\n");
  }
  return 0;
}
