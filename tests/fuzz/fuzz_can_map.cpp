// Any bytes as a map file; a map that is accepted decodes hostile frames without harm.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string_view>

#include "servosense/hal/can_decoder.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servosense;
  auto map =
      CanMap::parse({reinterpret_cast<const char*>(data), size}, "map");  // NOLINT: bytes as text
  if (!map) return 0;
  if (map->messages.size() > 16) return 0;  // slow, and no different
  for (const MapMessage& m : map->messages)
    if (m.every > 64) return 0;
  CanDecoder decoder(*map, 4);
  TraceRow row;
  Nanoseconds last = std::numeric_limits<Nanoseconds>::min();
  Nanoseconds t = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(size, 256); ++i) {
    CanFrame frame;
    t += data[i] < 250 ? map->period_ns / 4 : map->period_ns * data[(i + 1) % size];
    frame.t_ns = t - (data[i] % 3) * map->period_ns;
    const std::uint32_t key = map->messages[i % map->messages.size()].key;
    frame.id = key & 0x1FFFFFFF;
    frame.extended = (key >> 31U) != 0;
    frame.fd = true;
    frame.length = static_cast<std::uint8_t>(data[i] % 65);
    std::copy_n(data, std::min<std::size_t>(size, 64), frame.data.begin());
    frame.data[0] = static_cast<std::uint8_t>(i);
    if (map->sync_key && i % 3 == 0) frame.id = *map->sync_key & 0x1FFFFFFF;
    decoder.push(frame);
    while (decoder.pop(row)) {
      if (row.t_ns <= last || row.fields.size() != map->signals.size()) std::abort();
      last = row.t_ns;
    }
  }
  decoder.finish();
  while (decoder.pop(row)) {
    if (row.t_ns <= last) std::abort();
    last = row.t_ns;
  }
  return 0;
}
