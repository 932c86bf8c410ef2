// Any bytes as a candump log: an answer or a sentence; what is read is written and read back.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <string>

#include "servosense/io/candump.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servosense;
  auto reader = CandumpReader::from_stream(
      std::make_unique<std::istringstream>(
          std::string(reinterpret_cast<const char*>(data), size)),  // NOLINT: bytes as text
      "log");
  CanFrame frame;
  for (;;) {
    const auto more = reader.next(frame);
    if (!more || !*more) return 0;
    const auto back = parse_candump_line(candump_line(frame, "can0"));
    if (!back || !(back->frame == frame)) std::abort();
  }
}
