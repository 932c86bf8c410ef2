// Recordings as binary matrices: NAME.f32 holds 32-bit little-endian floats, row by row and nothing
// else; NAME.hdr beside it is text, one `key: value` a line, and names the channels:
//
//   format: float32 little-endian, interleaved (sample-major), no file header
//   samples: 122312
//   channels: 2
//   fs_hz: 1000
//   channel 0: speed_main [rpm] main-spindle speed
//   channel 1: current_main [raw] motor current, scale not published
//
// `samples`, `channels` and `fs_hz` (a number or `unknown`) may be left out. Other lines are
// remarks.
#pragma once

#include <cstdint>
#include <istream>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct MatrixHeader {
  struct Channel {
    std::string name;    ///< without blanks
    std::string unit;    ///< what stands in the brackets; may be empty
    std::string remark;  ///< what stands behind them; may be empty
  };
  std::vector<Channel> channels;     ///< at least one
  double rate_hz = 0;                ///< rows a second; 0: not stated
  std::uint64_t rows = 0;            ///< of the file with the numbers
  std::vector<std::string> remarks;  ///< lines that are nothing of the above
};

/// Reads the numbers row by row in constant memory.
class BinaryMatrix {
 public:
  /// `path`: of the .f32 or of the .hdr. Device error when either cannot be read; data error for a
  /// header without channels, another number format, or a size that is not that of the header.
  static Expected<BinaryMatrix> open(const std::string& path);
  /// Whether a file is one of the two, by its name.
  [[nodiscard]] static bool is_matrix(const std::string& path);

  [[nodiscard]] const MatrixHeader& header() const { return header_; }
  [[nodiscard]] const std::string& name() const { return name_; }  ///< of the .f32
  /// The next row, one value a channel; false at the end. Device error when reading fails.
  Expected<bool> next(std::span<float> row);
  Expected<Done> rewind();

 private:
  BinaryMatrix(MatrixHeader header, std::unique_ptr<std::istream> stream, std::string name);

  MatrixHeader header_;
  std::unique_ptr<std::istream> stream_;
  std::string name_;
  std::vector<unsigned char> bytes_;  // of a row
  std::uint64_t row_ = 0;
};

/// The matrix as the text of a table: remarks as comments, a heading `name [unit]`, rows with all
/// digits of a float, and in front a column `t_s` where the header states the rate and no channel
/// is so named. Can be rewound to its start and nowhere else. A row that cannot be read ends the
/// text with a failed stream.
[[nodiscard]] std::unique_ptr<std::istream> text_of(BinaryMatrix matrix);

}  // namespace servosense
