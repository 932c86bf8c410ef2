// Frequency response files: a measured receptance as comma separated text,
//   frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N[,coherence]
// Lines that begin with '#' are comments. Frequencies rise. The format: docs/files.md.
#pragma once

#include <complex>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"

namespace servosense {

/// Displacement over force at rising frequencies. All vectors have one length, but coherence may be
/// empty.
struct FrequencyResponse {
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> receptance_m_per_N;
  std::vector<double> coherence;  ///< 0..1
};

/// Data error naming file, line and column for anything malformed, device error if the file cannot
/// be read.
Expected<FrequencyResponse> read_frf(const std::string& path);
Expected<FrequencyResponse> read_frf(LineReader& lines);

/// The file's text; reads back as the same numbers.
[[nodiscard]] std::string frf_text(const FrequencyResponse& response);

}  // namespace servosense
