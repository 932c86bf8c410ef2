// servosense study cutoff: at which cutoff a contact stands out most from idling.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/identify/cutoff_study.hpp"
#include "study_page.hpp"

namespace servosense::cli {
namespace {

constexpr double kLeast_rad_s = 100, kMost_rad_s = 3000;
constexpr int kSteps = 60;

struct Sweep {
  std::string name, unit;
  std::vector<CutoffPoint> points;
  double best_rad_s = 0, best_ratio = 0;
  double from_rad_s = 0, to_rad_s = 0;  // nine tenths of the best ratio
};

CutoffPoint point_at(const Sweep& sweep, double cutoff) {
  return *std::min_element(sweep.points.begin(), sweep.points.end(),
                           [cutoff](const CutoffPoint& a, const CutoffPoint& b) {
                             return std::abs(a.cutoff_rad_s - cutoff) <
                                    std::abs(b.cutoff_rad_s - cutoff);
                           });
}

Sweep swept(std::string name, std::string unit, const DisturbanceObserverConfig& model,
            std::span<const DriveSample<double>> idle, const Contact& contact, Progress& progress) {
  Sweep sweep{std::move(name), std::move(unit), {}};
  std::vector<double> cutoffs = {335, 500, 1000, 1500, 1840, 2000, 2500};  // of the source
  for (int i = 0; i <= kSteps; ++i)
    cutoffs.push_back(kLeast_rad_s * std::pow(kMost_rad_s / kLeast_rad_s, i / double{kSteps}));
  std::sort(cutoffs.begin(), cutoffs.end());
  for (std::size_t i = 0; i < cutoffs.size(); ++i) {
    progress.show(static_cast<double>(i) / static_cast<double>(cutoffs.size()));
    if (cutoffs[i] * model.sample_period_s > 1) break;
    sweep.points.push_back(study_cutoff(model, idle, contact, cutoffs[i]));
  }
  for (const CutoffPoint& p : sweep.points)
    if (p.ratio() > sweep.best_ratio) {
      sweep.best_ratio = p.ratio();
      sweep.best_rad_s = p.cutoff_rad_s;
    }
  for (const CutoffPoint& p : sweep.points)
    if (p.ratio() >= 0.9 * sweep.best_ratio) {
      if (sweep.from_rad_s == 0) sweep.from_rad_s = p.cutoff_rad_s;
      sweep.to_rad_s = p.cutoff_rad_s;
    }
  return sweep;
}

std::vector<Compared> cutoff_compared(const Sweep& s) {
  const char* source = "Koike 2016, sec. 5.3";
  double never = std::numeric_limits<double>::quiet_NaN();
  for (const CutoffPoint& p : s.points)
    if (std::isfinite(p.seen_after_s)) never = p.cutoff_rad_s;
  double latest = 0;
  for (const CutoffPoint& p : s.points)
    if (p.cutoff_rad_s >= 300 && p.cutoff_rad_s <= 1600 && std::isfinite(p.seen_after_s))
      latest = std::max(latest, 1e3 * p.seen_after_s);
  std::vector<Compared> rows = {
      {"cutoff at which a contact stands out most", "=", 335, s.best_rad_s, "rad/s", source},
      {"contact over idling there", "=", 9.6, s.best_ratio, "", source},
      {"largest force rate in idling at 335 rad/s", "=", 6190, point_at(s, 335).idle_rate, "N/s",
       source},
      {"largest force rate in idling at 1000 rad/s", "<", 70000, point_at(s, 1000).idle_rate, "N/s",
       source},
      {"force rate of the contact at 335 rad/s", "=", 59700, point_at(s, 335).contact_rate, "N/s",
       source},
      {"force rate of the contact at 1000 rad/s", "=", 280000, point_at(s, 1000).contact_rate,
       "N/s", source},
      {"latest contact between 300 and 1600 rad/s", "<", 3, latest, "ms", source},
      {"highest cutoff at which it is seen", "=", 1840, never, "rad/s", source}};
  for (const auto& [cutoff, published] :
       {std::pair{1000.0, 50.65}, {1500.0, 90.01}, {2000.0, 144.2}, {2500.0, 215.7}})
    rows.push_back({"standard deviation of the force at " + report::Cell(cutoff, 4).text + " rad/s",
                    "=", published, point_at(s, cutoff).idle_force, "N", "Koike 2016, fig. 5-3"});
  return rows;
}

report::Plot cutoff_picture(const Sweep& s) {
  report::Plot plot;
  plot.title = s.name + ": contact over idling";
  plot.caption = "Largest force rate of the contact over the largest of the idling run.";
  plot.x_label = "cutoff", plot.x_unit = "rad/s";
  plot.y_label = "ratio", plot.log_x = true;
  report::Series ratio{"contact over idling"};
  for (const CutoffPoint& p : s.points) {
    ratio.x.push_back(p.cutoff_rad_s);
    ratio.y.push_back(p.ratio());
  }
  plot.series = {std::move(ratio)};
  plot.marks = {{s.best_rad_s, "best", report::Level::info}};
  plot.spans = {{s.from_rad_s, s.to_rad_s, "nine tenths of the best", report::Level::info}};
  plot.limits = {{1, "the contact is lost in idling", report::Level::warning}};
  return plot;
}

report::Plot cutoff_peaks(const Sweep& s) {
  report::Plot plot;
  plot.title = s.name + ": what the two are";
  plot.x_label = "cutoff", plot.x_unit = "rad/s";
  plot.y_label = "largest force rate", plot.log_x = plot.log_y = true;
  report::Series idle{"idling", s.unit + "/s"}, contact{"contact", s.unit + "/s"};
  for (const CutoffPoint& p : s.points) {
    idle.x.push_back(p.cutoff_rad_s), idle.y.push_back(p.idle_rate);
    contact.x.push_back(p.cutoff_rad_s), contact.y.push_back(p.contact_rate);
  }
  plot.series = {std::move(idle), std::move(contact)};
  return plot;
}

int run_study_cutoff(const Arguments& arguments) {
  if (arguments.has("--machine") != arguments.has("--trace"))
    return fail(usage_error("--machine and --trace go together: an idling run of that machine"));
  Contact contact;
  const auto rate = arguments.positive("--contact-rate");
  if (!rate) return fail(rate.error());
  contact.rate = rate->value_or(contact.rate);
  const auto lasts = arguments.within("--contact-s", 1e-4, 1, " s");
  if (!lasts) return fail(lasts.error());
  contact.duration_s = lasts->value_or(contact.duration_s);
  Progress progress("sweeping cutoffs", arguments.quiet());
  std::vector<Sweep> own;
  if (const auto path = arguments.value("--machine")) {
    const auto machine = MachineFile::read(*path);
    if (!machine) return fail(machine.error());
    const auto read = study_records(*machine, arguments.at("--trace"), arguments.quiet());
    if (!read) return fail(read.error());
    for (const DriveRecord& r : read->records) {
      if (!is_axis(r.channel)) continue;
      const HostDriveSlotConfig& slot = *read->plan.slot_of(r.channel);
      DisturbanceObserverConfig model = slot.observer;
      model.sample_period_s = r.sample_period_s;
      own.push_back(swept(std::string(name_of(r.channel)), is_turning(r.channel) ? "Nm" : "N",
                          model, r.samples, contact, progress));
    }
    if (own.empty())
      return fail(
          data_error(arguments.at("--trace") +
                     ": holds no axis; record an idling run of one, its motion and effort"));
  }
  const StudiedAxis axis = studied_axis();
  const Sweep source = swept("axis of the source", "N", axis.model, axis.idle, Contact{}, progress);
  const std::vector<Compared> rows = cutoff_compared(source);
  if (const auto path = arguments.value("--report")) {
    report::Report page("Choice of the cutoff for contacts", "Koike 2016, sec. 5.3");
    page.add(report::Paragraph{
        "A low cutoff spreads a contact of some milliseconds over its own time constant, while "
        "what "
        "accelerations leave stays; a high one hears the encoder, whose share of the force rate "
        "grows with the third power of the cutoff. Between them a contact stands out most."});
    page.add(compared_table(rows));
    page.add(cutoff_picture(source)).add(cutoff_peaks(source));
    for (const Sweep& s : own) page.add(cutoff_picture(s)).add(cutoff_peaks(s));
    page.add(report::Paragraph{
        "Assumed of the source's axis: a mass 2 % off, 0.16 um of noise on the position (its "
        "published noise of the force at 2000 rad/s), and a contact that rises with 354 kN/s for "
        "4.4 ms (its published force rates at 335 and 1000 rad/s)."});
    if (auto done = page.write(*path); !done) return fail(done.error());
  }
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    write_compared(json, rows);
    std::vector<const Sweep*> all = {&source};
    for (const Sweep& s : own) all.push_back(&s);
    json.objects("sweeps", all, [&](const Sweep* s) {
      json.member("drive", s->name);
      json.member("unit", s->unit);
      json.member("best_cutoff_rad_s", s->best_rad_s);
      json.member("best_ratio", s->best_ratio);
      json.member("from_rad_s", s->from_rad_s);
      json.member("to_rad_s", s->to_rad_s);
      json.objects("points", s->points, [&](const CutoffPoint& p) {
        json.member("cutoff_rad_s", p.cutoff_rad_s);
        json.member("ratio", p.ratio());
        json.member("idle_force", p.idle_force);
        json.member("idle_rate", p.idle_rate);
        json.member("contact_rate", p.contact_rate);
        json.member("seen_after_s", p.seen_after_s);
      });
    });
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say_compared(rows);
  for (const Sweep& s : own) {
    say("  %s: the contact stands out most at %.3g rad/s, %.3g times the idling run; %.3g to %.3g "
        "rad/s give nine tenths of that\n",
        s.name.c_str(), s.best_rad_s, s.best_ratio, s.from_rad_s, s.to_rad_s);
    if (s.best_ratio < 1)
      say("  %s: at no cutoff does such a contact exceed the idling run\n", s.name.c_str());
  }
  return 0;
}

}  // namespace

Program study_cutoff_program() {
  return {{"study cutoff", "cutoff at which a contact stands out most from idling",
           study_options({{"--contact-rate", "VALUE", "of the contact, N/s or Nm/s (354e3)"},
                          {"--contact-s", "SECONDS", "how long the force rises (4.4e-3)"}},
                         "idling run of the axes of --machine"),
           "",
           "Koike 2016, sec. 5.3, with its published figures beside; and the axes of an idling run "
           "of yours."},
          run_study_cutoff};
}

}  // namespace servosense::cli
