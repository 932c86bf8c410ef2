// The log that `candump -L` (can-utils) writes and `canplayer` sends: one frame a line.
//
//   (1436509052.249713) can0 244#2A366C2BBA      classic; 3 digits of identifier, or 8 (extended)
//   (1436509052.249713) can0 244#R8              remote frame, 8 bytes asked for
//   (1436509052.249713) can0 244##1A0B1          FD; first digit: 1 bit rate switch, 2 error state
//   (1436509052.249713) can0 20000040#00...      error frame
//
// Up to nine decimals of time; dots between bytes, a raw length code (_9 to _F) and the direction
// (T, R) at the end of a line are understood.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/io/can_frame.hpp"
#include "servosense/io/line_reader.hpp"

namespace servosense {

struct CandumpLine {
  CanFrame frame;
  std::string interface;
};

/// Data error: what was expected, without the place, which the caller knows.
Expected<CandumpLine> parse_candump_line(std::string_view line);
/// The line without its end, six decimals of time unless the frame's own are finer.
[[nodiscard]] std::string candump_line(const CanFrame& frame, std::string_view interface);

/// Reads a log frame by frame. Blank lines and lines that begin with '#' are passed over; any other
/// malformed line is a data error that names file and line.
class CandumpReader {
 public:
  /// `interface`: only its frames; empty: those of all.
  static Expected<CandumpReader> open(const std::string& path, std::string interface = {});
  static CandumpReader from_stream(std::unique_ptr<std::istream> stream, std::string name,
                                   std::string interface = {});

  /// False at the end.
  Expected<bool> next(CanFrame& frame);
  [[nodiscard]] const LineReader& lines() const { return lines_; }

 private:
  CandumpReader(LineReader lines, std::string interface)
      : lines_(std::move(lines)), interface_(std::move(interface)) {}

  LineReader lines_;
  std::string interface_;
};

}  // namespace servosense
