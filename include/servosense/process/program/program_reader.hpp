// Reads an NC program and gives what it asks of the machine, step by step.
//
//   ProgramText text = *ProgramText::read("part.ngc");
//   run_program(text, {}, [&](const CanonicalMove& move) { ... });
//
// Codes, order of execution within a block and refusals are those of LinuxCNC 2.9
// (docs/nc-program.md names the few on purpose others). What is not supported is refused by line,
// never passed over.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/process/program/block.hpp"
#include "servosense/process/program/canonical_move.hpp"
#include "servosense/process/program/limits.hpp"
#include "servosense/process/program/tool_table.hpp"

namespace servosense::process {

/// The lines of a program, and of the subroutines that stand in files of their own.
class ProgramText {
 public:
  /// Subroutine `name` is sought as `name.ngc` beside the program.
  static Expected<ProgramText> read(const std::string& path);
  /// From memory; a subroutine must stand in it.
  static ProgramText from(std::string_view text, std::string name);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const std::vector<std::string>& lines() const { return lines_; }
  /// The file of a subroutine, or nothing where there is none.
  [[nodiscard]] Expected<std::optional<ProgramText>> subroutine(const std::string& name) const;

 private:
  std::string name_;
  std::string folder_;  // empty: none
  std::vector<std::string> lines_;
};

struct ProgramOptions {
  Dialect dialect = Dialect::linuxcnc;
  bool block_delete = false;  ///< leaves out lines that begin with '/'
  /// Without one every tool exists, and has neither length nor diameter.
  std::optional<ToolTable> tools;
  /// Numbered parameters at the start, those of the work offsets among them.
  std::map<long, double> parameters;
  std::uint64_t most_lines = kMostLinesRun;  ///< looked at, before the program counts as endless
  std::uint64_t most_moves = kMostMoves;
};

/// Where a program stopped with an error.
struct ProgramPlace {
  std::string file;
  std::size_t line = 0;
};

/// Runs the program from its first line to its end. Data error "FILE:LINE: what is wrong, what to
/// do"; `place` then says where, and `sink` has had all moves before.
Expected<Done> run_program(const ProgramText& program, const ProgramOptions& options,
                           const std::function<void(const CanonicalMove&)>& sink,
                           ProgramPlace* place = nullptr);

}  // namespace servosense::process
