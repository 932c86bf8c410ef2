// A program given move by move to what cuts it, and the stock that it meets.
#pragma once

#include <span>
#include <string>

#include "arguments.hpp"
#include "console.hpp"
#include "program_moves.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::cli {

/// `taker`: a ProgramEngagement or a ProgramCheck. An error names the program.
template <typename Taker>
Expected<Done> give_moves(const std::string& program, std::span<const process::CanonicalMove> moves,
                          Taker& taker, Progress& progress) {
  constexpr std::size_t kSeldom = 256;
  for (const process::CanonicalMove& move : moves) {
    if (const auto done = taker.put(move); !done)
      return Error{done.error().kind, program + ": " + done.error().sentence};
    if (taker.moves() % kSeldom == 0)
      progress.show(static_cast<double>(taker.moves()) / static_cast<double>(moves.size()));
  }
  taker.finish();
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
