// A program given move by move to what cuts it, and the stock that it meets.
#pragma once

#include <optional>
#include <string>

#include "arguments.hpp"
#include "console.hpp"
#include "program_moves.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::cli {

/// `taker`: a ProgramEngagement or a ProgramCheck. `of`: moves of the program; 0: no progress.
template <typename Taker>
Expected<Done> give_moves(const process::ProgramText& program,
                          const process::ProgramOptions& options, Taker& taker, Progress& progress,
                          std::size_t of) {
  // The reader goes on to its end; what comes after the first refusal is not looked at.
  std::optional<Error> refused;
  const auto read = process::run_program(program, options, [&](const process::CanonicalMove& move) {
    if (refused) return;
    if (const auto done = taker.put(move); !done) refused = done.error();
    if (of > 0 && taker.moves() % 256 == 0)
      progress.show(static_cast<double>(taker.moves()) / static_cast<double>(of));
  });
  taker.finish();
  if (!read) return read.error();
  if (refused) return Error{refused->kind, program.name() + ": " + refused->sentence};
  return Done{};
}

/// Stock of `--stock`, in lines `--tolerance` apart, cut by the programs of `--after`.
struct CutStock {
  process::Workpiece workpiece;
  double spacing_m = 0;
  double mesh_unit_m = 0;  ///< of `--stl-unit`; 0: not given
};
Expected<CutStock> stock_of(const Arguments& arguments, const process::ProgramOptions& options,
                            process::MachineTools& tools, double smallest_radius_m,
                            Progress& progress);

/// --stock, --after, --tolerance, --stl-unit.
std::vector<Option> stock_options();

}  // namespace servosense::cli
