// servosense recommend: the most productive cut that is stable with a stated probability.
#include <cmath>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "recommend_answer.hpp"
#include "recommend_inputs.hpp"
#include "servosense/identify/stability_lobes.hpp"

namespace servosense::cli {
namespace {

constexpr Eigen::Index kSamples = 1000;  // 95 % to 0.7 %

/// Of the values of the file, for comparison; nothing where the method does not know the tool.
std::vector<double> zeroth_order(const UncertainCut& cut, const std::vector<double>& speeds) {
  std::vector<double> depth;
  if (cut.structure_is_unknown()) return depth;
  const auto lobes = StabilityLobes::from_modes(cut.structure(), cut.tool(), cut.cut());
  if (!lobes) return depth;
  for (const double speed : speeds) depth.push_back(lobes->limit_at(speed).axial_depth_m);
  return depth;
}

Expected<RecommendAnswer> answer_to(const Arguments& arguments, const RecommendInputs& inputs,
                                    double probability) {
  RecommendAnswer answer;
  answer.remarks = inputs.remarks;
  for (const std::string& path : arguments.all("--cuts")) {
    auto cuts = read_watched_cuts(path);
    if (!cuts) return cuts.error();
    answer.cuts.insert(answer.cuts.end(), cuts->begin(), cuts->end());
  }
  if (arguments.has("--cuts") && answer.cuts.empty())
    return data_error("--cuts: no cut is in the files; write a line for each cut that was watched");
  CutBelief belief;
  if (answer.cuts.empty()) {
    belief = prior_belief(inputs.cut, kSamples);
  } else {
    Progress progress("learning from cuts", arguments.quiet());
    WatchedCutsConfig config;
    config.progress = [&](double share) { progress.show(share); };
    auto learned = learn_from_cuts(inputs.cut, answer.cuts, config);
    if (!learned) return learned.error();
    belief = learned->belief;
    answer.learned = std::move(*learned);
  }
  RecommendConfig config;
  config.probability = probability;
  Progress progress("mapping", arguments.quiet());
  config.progress = [&](double share) { progress.show(share); };
  auto found = recommend_cut(inputs.cut, belief, inputs.limits, config);
  if (!found) return found.error();
  answer.found = std::move(*found);
  answer.zeroth_order_m = zeroth_order(inputs.cut, answer.found.spindle_speed_rpm);
  conclude(answer, probability);
  return answer;
}

int run_recommend(const Arguments& arguments) {
  auto probability = arguments.within("--probability", 0.5, 0.999);
  if (!probability) return fail(probability.error());
  const double asked = probability->value_or(0.95);
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto inputs = recommend_inputs(*machine);
  if (!inputs) return fail(inputs.error());
  auto answer = answer_to(arguments, *inputs, asked);
  if (!answer) return fail(answer.error());
  if (!arguments.quiet())
    for (const std::string& remark : answer->remarks) note(remark);
  if (const auto path = arguments.value("--report"))
    if (auto done =
            write_recommendation_report(*path, arguments.at("--machine"), *inputs, *answer, asked);
        !done)
      return fail(done.error());
  if (arguments.json())
    print_recommendation_json(*inputs, *answer);
  else
    print_recommendation(*answer);
  return 0;
}

}  // namespace

Program recommend_program() {
  return {
      {"recommend",
       "the most productive cut that is stable with a stated probability",
       {{"--machine", "FILE",
         "machine file with [tool], [cut], [limits], and modes if they are known", true,
         FileUse::input},
        {"--probability", "P", "that the cut is to be stable with, 0.5 to 0.999 (0.95)"},
        {.name = "--cuts",
         .value = "FILE",
         .meaning = "cuts that were watched, as JSON Lines; may be given several times",
         .use = FileUse::input,
         .repeated = true},
        {"--report", "FILE", "HTML page with the map of probability", false, FileUse::output}},
       "",
       "Engagement is that of [cut]; speed, depth and feed are sought. How well things are known "
       "is "
       "in\n"
       "[tool] tangential_coefficient_relative_error and [structure.*] modes_relative_error; what "
       "is not stated\n"
       "is taken from typical errors, and said. Without any modes the cuts alone tell of the "
       "structure.\n"
       "A line of --cuts: {\"spindle_speed_rpm\": 8000, \"axial_depth_m\": 0.002, \"stable\": "
       "false, "
       "\"chatter_hz\": 950}"},
      run_recommend};
}

}  // namespace servosense::cli
