// The blocks as a table that can be walked at run time.
#pragma once

#include <span>

#include "../blocks.hpp"

namespace bench {

struct TableEntry {
  const char* name;
  void* block;
  Status (*configure)(void* block);
  float (*step)(void* block, const Sample<float>& in);
};

/// Every block; the first is the empty one.
std::span<const TableEntry> block_table() noexcept;

}  // namespace bench
