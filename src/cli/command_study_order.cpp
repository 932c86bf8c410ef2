// servosense study order: how long an autoregressive model of a recording must be.
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/ar_order.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/trace.hpp"
#include "study_page.hpp"

namespace servosense::cli {
namespace {

constexpr std::array<std::size_t, 4> kPublished = {3, 11, 30, 46};  // Bertok 1984, fig. 3.6
constexpr double kShareOfMean = 2e-4;                               // his V = 0.1 at a mean of 500
constexpr std::size_t kMostSamples = 20000;

/// Spindle current of the source's face mill: six teeth unevenly set, 12 samples a turn, 61 of 125
/// mm wide, through a first order lag of 16 Hz, with noise.
std::vector<double> face_mill() {
  constexpr std::array kThrow = {1.0, 0.8, 1.15, 0.9, 1.1, 1.05};
  constexpr double kPeriod_s = 0.02, kTurns_s = 250.0 / 60, kWidth_rad = 1.55;
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise;
  std::vector<double> z;
  double lagged = 500;
  constexpr int kFine = 20;
  const double keep = std::exp(-kTwoPi * 16 * kPeriod_s / kFine);
  for (int i = 0; i < 3000 * kFine; ++i) {
    const double angle = kTwoPi * kTurns_s * kPeriod_s * i / kFine;
    double torque = 0;
    for (std::size_t k = 0; k < kThrow.size(); ++k) {
      const double at = std::remainder(angle - kTwoPi * static_cast<double>(k) / 6, kTwoPi);
      if (std::abs(at) < kWidth_rad / 2) torque += 350 * kThrow[k] * std::cos(at);
    }
    lagged = keep * lagged + (1 - keep) * (torque + 20 * noise(random));
    if (i % kFine == 0) z.push_back(lagged + 3 * noise(random));
  }
  return z;
}

struct OrderRecord {
  std::string name;
  std::vector<double> samples;
  double period_s = 0.02;
};

Expected<OrderRecord> order_record(const Arguments& arguments, std::size_t every) {
  const auto path = arguments.value("--trace");
  if (!path) return OrderRecord{"face mill of the source, simulated", face_mill()};
  const auto trace = read_trace(*path);
  if (!trace) return trace.error();
  std::string name = arguments.value("--column").value_or("");
  if (name.empty())
    for (const Signal& s : trace->signals)
      if (s.quantity == Quantity::current_A || s.quantity == Quantity::torque_Nm ||
          s.quantity == Quantity::force_N) {
        name = column_name(s);
        break;
      }
  const auto at = column_named(trace->signals, name);
  if (!at)
    return data_error(*path + ": there is no " +
                      (name.empty() ? "column of a current, torque or force" : "column " + name) +
                      "; name one that it has with --column");
  OrderRecord r{name, {}, static_cast<double>(every) / trace->sample_rate_hz()};
  double sum = 0;
  std::size_t in = 0;
  for (std::size_t row = 0; row < trace->size() && r.samples.size() < kMostSamples; ++row) {
    if (!trace->updated[*at][row]) continue;
    const double value = trace->columns[*at][row];
    if (!std::isfinite(value))
      return data_error(*path + ": " + name + " is no number at " +
                        report::Cell(trace->t_s[row], 6).text + " s; cut the trace before it");
    sum += value;
    if (++in < every) continue;
    r.samples.push_back(sum / static_cast<double>(every));
    sum = 0;
    in = 0;
  }
  return r;
}

std::string orders_listed(const std::vector<std::size_t>& orders) {
  std::string text;
  for (const std::size_t p : orders) text += (text.empty() ? "" : ", ") + std::to_string(p);
  return text.empty() ? "none" : text;
}

int run_study_order(const Arguments& arguments) {
  const auto most = whole_option(arguments, "--most", 1, 256, 60);
  if (!most) return fail(most.error());
  const auto every = whole_option(arguments, "--every", 1, 1e6, 1);
  if (!every) return fail(every.error());
  for (const char* option : {"--column", "--every"})
    if (arguments.has(option) && !arguments.has("--trace"))
      return fail(usage_error(std::string(option) + " is of a trace; give --trace"));
  const auto record = order_record(arguments, *every);
  if (!record) return fail(record.error());
  double mean = 0, square = 0;
  for (const double z : record->samples) mean += z, square += z * z;
  mean /= static_cast<double>(std::max<std::size_t>(record->samples.size(), 1));
  square /= static_cast<double>(std::max<std::size_t>(record->samples.size(), 1));
  // Of a record without a mean, of its size.
  const auto given = arguments.positive("--noise-variance");
  if (!given) return fail(given.error());
  const double variance = given->value_or(
      std::max(kShareOfMean * std::max(std::abs(mean), 0.01 * std::sqrt(square)), 1e-12));
  const auto curve = ar_order_curve(record->samples, *most, variance);
  if (!curve) return fail(curve.error());
  const std::vector<std::size_t> candidates = candidate_orders(curve->aic);
  double turn = 0;  // samples of a revolution
  if (const auto path = arguments.value("--machine")) {
    const auto machine = MachineFile::read(*path);
    if (!machine) return fail(machine.error());
    const auto rpm = machine->required_number("cut", "spindle_speed_rpm");
    if (!rpm) return fail(rpm.error());
    turn = 60 / *rpm / record->period_s;
  } else if (!arguments.has("--trace")) {
    turn = 12;
  }
  if (const auto path = arguments.value("--report")) {
    report::Report page("Order of an autoregressive model", record->name);
    page.add(report::Paragraph{
        "Candidates are the orders at which Akaike's criterion stops falling for a while. One "
        "revolution must be covered, two are good, more gain nothing (Bertok 1984, sec. 3.3.2.3). "
        "The published curve is of another record, and so are the places of its falls."});
    report::Table table{"Published beside obtained", {}, {"", "published", "obtained"}};
    table.rows.push_back(
        {{"candidates", "3, 11, 30, 46", orders_listed(candidates)}, report::Level::none});
    table.rows.push_back(
        {{"least AIC", "not stated", std::to_string(curve->least_aic)}, report::Level::none});
    table.rows.push_back(
        {{"least FPE", "not stated", std::to_string(curve->least_fpe)}, report::Level::none});
    page.add(std::move(table));
    std::vector<double> orders;
    for (std::size_t p = 0; p < curve->aic.size(); ++p) orders.push_back(static_cast<double>(p));
    for (const bool aic : {true, false}) {
      report::Plot plot;
      plot.title = aic ? "Akaike's information criterion" : "Final prediction error";
      plot.x_label = "order";
      plot.y_label = aic ? "AIC" : "FPE";
      plot.log_y = !aic;
      plot.series = {{aic ? "AIC" : "FPE", "", orders, aic ? curve->aic : curve->fpe}};
      for (const std::size_t p : candidates)
        plot.marks.push_back({static_cast<double>(p), "candidate", report::Level::info});
      page.add(std::move(plot));
    }
    if (auto done = page.write(*path); !done) return fail(done.error());
  }
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("signal", record->name);
    json.member("samples", record->samples.size());
    json.member("sample_period_s", record->period_s);
    json.member("noise_variance", variance);
    if (turn > 0) json.member("samples_per_turn", turn);
    json.values("published_candidates", kPublished);
    json.values("candidates", candidates);
    json.member("least_aic", curve->least_aic);
    json.member("least_fpe", curve->least_fpe);
    json.values("aic", curve->aic);
    json.values("fpe", curve->fpe);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%s, %zu samples of %.4g s\n", record->name.c_str(), record->samples.size(),
      record->period_s);
  say("  candidates %s; published 3, 11, 30, 46 (Bertok 1984, fig. 3.6, another record)\n",
      orders_listed(candidates).c_str());
  say("  least AIC at %zu, least FPE at %zu\n", curve->least_aic, curve->least_fpe);
  if (turn > 0)
    say("  a revolution is %.3g samples: an order of %.0f covers one, %.0f two\n", turn,
        std::ceil(turn), std::ceil(2 * turn));
  return 0;
}

}  // namespace

Program study_order_program() {
  return {{"study order", "order of an autoregressive model of a recording, by AIC and FPE",
           study_options(
               {{"--column", "COLUMN", "of the trace; the first current, torque or force if not"},
                {"--every", "N", "means of so many rows (1); some 12 a revolution are enough"},
                {"--most", "N", "highest order (60)"},
                {"--noise-variance", "VALUE", "V of the model; 0.02 % of the mean if not given"}},
               "recording of a cut"),
           "",
           "Bertok 1984, sec. 3.3.2.3, with its published candidates beside. With --machine, [cut] "
           "tells how many\n"
           "samples a revolution has. Without --trace a face mill as the source's is simulated."},
          run_study_order};
}

}  // namespace servosense::cli
