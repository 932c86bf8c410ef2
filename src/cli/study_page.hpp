// What the studies have in common: published beside obtained, on a page and in JSON.
#pragma once

#include <string>
#include <vector>

#include "arguments.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/report.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

struct Compared {
  std::string what;
  std::string relation;  ///< "=" or "<": how the published figure is meant
  double published = 0;
  double obtained = 0;
  std::string unit;
  std::string source;  ///< where it is published
};

report::Table compared_table(const std::vector<Compared>& all);
void say_compared(const std::vector<Compared>& all);
/// Member `compared` of the object that is being written.
void write_compared(JsonWriter& json, const std::vector<Compared>& all);

/// A trace as the drives of a machine file saw it.
struct StudyRecords {
  StackPlan plan;
  std::vector<DriveRecord> records;
};
Expected<StudyRecords> study_records(const MachineFile& machine, const std::string& trace,
                                     bool quiet);

/// Options that every study has.
std::vector<Option> study_options(std::vector<Option> own, const std::string& of_trace);

/// A whole number from `least` to `most`; `standard` when the option was not given.
Expected<std::size_t> whole_option(const Arguments& arguments, const std::string& name,
                                   double least, double most, std::size_t otherwise);

}  // namespace servosense::cli
