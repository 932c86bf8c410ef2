// Frequency response files: a measured receptance, in one of three formats.
//   csv      frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N
//            [,coherence[,standard_error_m_per_N]] below that header
//   columns  the same three as bare numbers, between blanks, tabs or commas
//   uff58    ASCII dataset 58 of a universal file (SDRC 1980s, type 4: frequency response), with
//            the coherence as a dataset of type 6 and units as dataset 164
// Lines of the first two that begin with '#' are comments; `# exponential_window_per_s: RATE` is
// read. Frequencies rise. The formats: docs/files.md.
#pragma once

#include <complex>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"

namespace servosense {

/// Displacement over force at rising frequencies. All vectors have one length, but coherence and
/// standard error may be empty.
struct FrequencyResponse {
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> receptance_m_per_N;
  std::vector<double> coherence;               ///< 0..1
  std::vector<double> standard_error_m_per_N;  ///< of the complex value; needs coherence beside it
  /// Rate of the exponential window that was laid over the record [1/s], 0: none. Every pole of the
  /// response is so much further to the left than the pole of the structure.
  double exponential_window_per_s = 0;
};

enum class FrfFormat { csv, columns, uff58 };

/// Format of a file that is to be written: `name` (csv, columns, uff58), or when that is empty by
/// the ending of `path` (.uff, .unv, .uf58: uff58; .txt, .dat, .asc: columns; any other: csv).
/// Usage error for a name that is none.
Expected<FrfFormat> frf_format(const std::string& path, const std::string& name = "");

/// The format is recognised by what stands in the file. A universal file may hold velocity or
/// acceleration over force, which becomes displacement (the line at zero is left out then), in the
/// units that it names. Data error naming file, line and column for anything malformed, or for more
/// than one frequency response; device error if the file cannot be read.
Expected<FrequencyResponse> read_frf(const std::string& path);
Expected<FrequencyResponse> read_frf(LineReader& lines);

/// The file's text. `csv` reads back as the same numbers, `columns` without coherence and standard
/// error, `uff58` to 1e-9 of the highest frequency and 1e-12 of a value, without standard error.
/// `title` is a line about it.
[[nodiscard]] std::string frf_text(const FrequencyResponse& response,
                                   FrfFormat format = FrfFormat::csv,
                                   const std::string& title = "");

}  // namespace servosense
