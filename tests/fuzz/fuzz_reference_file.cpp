// Any bytes as a sound reference: an error of one line, or numbers that survive writing and
// reading, and that can be learned from or are refused.
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/identify/reference.hpp"

using namespace servosense;

namespace {
Expected<Reference> parsed(std::string text) {
  LineReader lines(std::make_unique<std::istringstream>(std::move(text)), "fuzz");
  return read_reference(lines);
}
}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto reference = parsed(std::string(reinterpret_cast<const char*>(data), size));
  if (!reference) {
    if (reference.error().sentence.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  const std::string text = reference_text(*reference);
  const auto again = parsed(text);
  if (!again || reference_text(*again) != text) std::abort();
  const auto learned = ReferenceDistance::learn(
      *reference, std::vector<bool>(reference->layout.signals.size(), true));
  if (!learned && learned.error().sentence.find('\n') != std::string::npos) std::abort();
  return 0;
}
