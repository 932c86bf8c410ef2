// One function a block and nothing else: this object is what the symbol gate reads and what the
// code sizes are taken from.
#include "block_table.hpp"

#include <array>

namespace bench {
namespace {

template <typename Case>
Case instance;

template <typename Case>
Status configure(void* block) {
  return static_cast<Case*>(block)->configure();
}
template <typename Case>
float step(void* block, const Sample<float>& in) {
  return static_cast<Case*>(block)->step(in);
}
template <typename Case>
constexpr TableEntry entry() {
  return {Case::name, &instance<Case>, configure<Case>, step<Case>};
}
template <typename... Case>
constexpr std::array<TableEntry, 1 + sizeof...(Case)> table(std::tuple<Case...>*) {
  return {entry<EmptyCase<float>>(), entry<Case>()...};
}

constexpr auto kTable = table(static_cast<Blocks<float>*>(nullptr));

}  // namespace

std::span<const TableEntry> block_table() noexcept { return kTable; }

}  // namespace bench
