// servosense identify reference: what sound cuts of a tool and program section look like.
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "output_check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/learn_reference.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::cli {
namespace {

int run_identify_reference(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::vector<std::string>& traces = arguments.operands();
  if (traces.empty())
    return fail(usage_error("give one trace or more of sound cuts, of one tool and section"));
  for (const std::string& path : traces)
    if (auto done = check_rereadable(path); !done) return fail(done.error());
  LearnReferenceOptions options;
  const auto window = arguments.positive("--window-s");
  if (!window) return fail(window.error());
  options.window_s = window->value_or(0);
  const auto rate = arguments.within("--false-alarms", 1e-6, 0.1);
  if (!rate) return fail(rate.error());
  options.false_alarms = rate->value_or(options.false_alarms);
  Progress progress("reading", arguments.quiet());
  options.progress = [&](double share) { progress.show(share); };
  auto learned = learn_reference(*machine, traces, options);
  if (!learned) return fail(learned.error());
  const auto learn_distance = [&] {
    return ReferenceDistance::learn(
        learned->reference, std::vector<bool>(learned->reference.layout.signals.size(), true));
  };
  auto distance = learn_distance();
  // Short stretches of many blocks and speeds take shorter windows.
  while (!distance && !arguments.has("--window-s")) {
    options.window_s = learned->reference.layout.window_s / 2;
    if (options.window_s < least_window_s(learned->reference.layout)) break;
    auto shorter = learn_reference(*machine, traces, options);
    if (!shorter) return fail(shorter.error());
    learned = std::move(shorter);
    distance = learn_distance();
  }
  if (!distance) return fail(data_error(traces.front() + ": " + distance.error().sentence));
  const Reference& reference = learned->reference;
  for (const std::string& remark : learned->remarks) note(remark, arguments.quiet());
  const std::string& out = arguments.at("--out");
  char line[200];
  std::snprintf(line, sizeof line, "%zu windows of sound cuts from %zu trace(s); threshold %.3g",
                reference.sound.size(), traces.size(), distance->threshold());
  const std::vector<std::string> comments = {
      "what sound cuts look like, servosense identify reference", line};
  if (auto done = write_file(out, reference_text(reference, comments)); !done)
    return fail(done.error());
  const double highest =
      *std::max_element(distance->held_out().begin(), distance->held_out().end());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", out);
    json.member("windows", reference.sound.size());
    json.member("window_s", reference.layout.window_s);
    json.member("cutting_s", learned->cutting_s);
    json.member("total_s", learned->total_s);
    json.member("cutting_level", reference.layout.cutting_level);
    json.member("effort", column_name(reference.layout.signals[reference.layout.effort].signal));
    json.member("speed_rpm", rpm_from_rad_s(reference.layout.speed_rad_s));
    json.key("signals");
    json.begin_array();
    for (const ReferenceSignal& s : reference.layout.signals) json.value(column_name(s.signal));
    json.end_array();
    json.objects("traces", traces, [&](const std::string& path) {
      json.member("trace", path);
      json.member("windows", learned->windows[static_cast<std::size_t>(&path - traces.data())]);
    });
    json.member("threshold", distance->threshold());
    json.member("highest_sound", highest);
    json.member("false_alarms", reference.false_alarms);
    json.member("false_alarms_extrapolated", distance->extrapolated_rate());
    json.member("false_alarms_supported", distance->supported_rate());
    json.member("seen_ratio", distance->seen_ratio());
    json.values("remarks", learned->remarks);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%zu windows of %.3g s from %.3g s of cutting in %zu trace(s)\n", reference.sound.size(),
      reference.layout.window_s, learned->cutting_s, traces.size());
  for (std::size_t t = 0; t < traces.size(); ++t)
    say("  %s: %zu\n", traces[t].c_str(), learned->windows[t]);
  say("threshold %.3g; the sound windows reach %.3g, their record held out. Beyond it are %.2g of "
      "the sound windows by the tail of their distances; so few windows bear out no less than "
      "%.2g\n",
      distance->threshold(), highest, distance->extrapolated_rate(), distance->supported_rate());
  if (traces.size() == 1)
    say("one trace shows no spread from cut to cut: 5 %% of every amplitude is assumed; give two "
        "traces or more\n");
  say("an order or band is seen when it grows to %.3g times its sound amplitude (the middle one)\n",
      distance->seen_ratio());
  say("written to %s; name it as reference in [monitor.reference]\n", out.c_str());
  return 0;
}

}  // namespace

Program identify_reference_program() {
  return {{"identify reference",
           "what sound cuts of a tool and program section look like, from traces of them",
           {{"--machine", "FILE", "machine file", true, FileUse::input},
            {"--out", "FILE", "reference to write", true, FileUse::renewed},
            {"--window-s", "S", "length of a window (chosen from the cuts)", false},
            {"--false-alarms", "P", "share of sound windows that may alarm (0.001)", false}},
           "TRACE...",
           "The traces are of sound cuts of one tool and one section of a program, each a record\n"
           "of its own: what differs between them is what later cuts may differ by."},
          run_identify_reference};
}

}  // namespace servosense::cli
