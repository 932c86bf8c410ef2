// Any bytes as a DBC file: every signal that is not refused lies within its message, and a CAN map
// of it decodes any frame.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "servosense/hal/can_decoder.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servosense;
  const std::string_view text(reinterpret_cast<const char*>(data), size);  // NOLINT: bytes as text
  const auto dbc = Dbc::parse(text, "bus.dbc");
  if (!dbc) {
    const std::string& sentence = dbc.error().sentence;
    if (!sentence.starts_with("bus.dbc:") || sentence.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  std::string map = "period_s = 0.001\ndbc = bus.dbc\nsignal, dbc, factor, every\n";
  std::size_t columns = 0;
  for (const DbcMessage& message : dbc->messages()) {
    for (const DbcSignal& signal : message.signals) {
      if (columns == kQuantityNames.size()) break;
      const std::string path = message.name + '.' + signal.name;
      const auto found = dbc->find(path);
      if (found.has_value() != signal.outside.empty()) std::abort();
      if (!found) continue;
      CanFrame frame;
      frame.length = static_cast<std::uint8_t>(message.bytes);
      if (!raw_bits(frame.bytes(), found->signal.bits)) std::abort();
      const Signal column{Channel::x, static_cast<Quantity>(columns++)};
      map += column_name(column) + ", " + path + ", 1, 2\n";
    }
  }
  auto filled = CanMap::parse(map, "map", text);
  if (!filled) return 0;  // counts that are none
  CanDecoder decoder(*filled, 4);
  TraceRow row;
  for (std::size_t i = 0; i < std::min<std::size_t>(size, 64); ++i) {
    const MapMessage& message = filled->messages[i % filled->messages.size()];
    CanFrame frame;
    frame.t_ns = static_cast<Nanoseconds>(i) * filled->period_ns;
    frame.id = message.key & 0x1FFFFFFF;
    frame.extended = (message.key >> 31U) != 0;
    frame.length = static_cast<std::uint8_t>(data[i] % 65);
    std::copy_n(data + i, std::min<std::size_t>(size - i, 64), frame.data.begin());
    decoder.push(frame);
    while (decoder.pop(row))
      if (row.fields.size() != filled->signals.size()) std::abort();
  }
  return 0;
}
