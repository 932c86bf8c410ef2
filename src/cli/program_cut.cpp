#include "program_cut.hpp"

#include <utility>
#include <variant>

#include "servosense/io/text.hpp"
#include "servosense/process/engagement/turning_tools.hpp"
#include "servosense/process/workpiece/stock.hpp"

namespace servosense::cli {

Expected<CutStock> stock_of(const Arguments& arguments, const process::ProgramOptions& options,
                            process::MachineTools& tools, double smallest_radius_m,
                            Progress& progress) {
  const auto tolerance = arguments.positive("--tolerance");
  if (!tolerance) return tolerance.error();
  const auto unit = arguments.positive("--stl-unit");
  if (!unit) return unit.error();
  const auto stock = process::read_stock(arguments.at("--stock"), unit->value_or(0));
  if (!stock) return stock.error();
  if (std::holds_alternative<process::Mesh>(*stock) && !*unit) {
    const auto box = process::bounds_of(*stock);
    const auto side = [&](std::size_t i) { return printed((box.high[i] - box.low[i]) * 1e3); };
    note("the stock is taken to be " + side(0) + " x " + side(1) + " x " + side(2) +
             " mm: an STL file has no unit (--stl-unit gives it)",
         arguments.quiet());
  }
  const double spacing_m =
      tolerance->value_or(process::default_spacing_m(*stock, smallest_radius_m));
  auto workpiece = process::Workpiece::of(*stock, spacing_m);
  if (!workpiece) return workpiece.error();
  for (const std::string& path : arguments.all("--after")) {
    const auto before = process::ProgramText::read(path);
    if (!before) return before.error();
    const auto moves = read_moves(*before, options);
    if (!moves) return moves.error();
    process::ProgramEngagement engagement(*workpiece, process::cutters_of(tools),
                                          [](const process::Engagement&) {});
    if (const auto done = give_moves(before->name(), *moves, engagement, progress); !done)
      return done.error();
  }
  return CutStock{std::move(*workpiece), spacing_m, unit->value_or(0)};
}

std::vector<Option> stock_options() {
  return {{"--stock", "STOCK",
           "box:X0,Y0,Z0,X1,Y1,Z1 or cylinder:X,Y,Z0,Z1,R in metres, or an STL file", true,
           FileUse::input},
          {"--after",
           "FILE",
           "a program that has cut the stock before",
           false,
           FileUse::input,
           {},
           true},
          {"--tolerance", "M",
           "spacing of the lines that hold the part [m] (0.1 mm, or what the tools and the stock "
           "ask for)"},
          {"--stl-unit", "M",
           "unit of the STL files [m] (millimetres, or metres if it is below "
           "1)"}};
}

}  // namespace servosense::cli
