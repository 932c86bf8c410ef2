// Any bytes as a receptance file: an error of one line, or numbers that survive writing and
// reading.
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/io/frf_file.hpp"

using namespace servosense;

namespace {
Expected<FrequencyResponse> parsed(std::string text) {
  LineReader lines(std::make_unique<std::istringstream>(std::move(text)), "fuzz");
  return read_frf(lines);
}
}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto frf = parsed(std::string(reinterpret_cast<const char*>(data), size));
  if (!frf) {
    if (frf.error().sentence.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  const auto again = parsed(frf_text(*frf));
  if (!again || again->frequency_hz != frf->frequency_hz ||
      again->receptance_m_per_N != frf->receptance_m_per_N || again->coherence != frf->coherence)
    std::abort();
  // A universal file rounds frequencies: those that lie too close together do not rise any more.
  const auto universal = parsed(frf_text(*frf, FrfFormat::uff58));
  if (universal && universal->frequency_hz.size() != frf->frequency_hz.size()) std::abort();
  return 0;
}
