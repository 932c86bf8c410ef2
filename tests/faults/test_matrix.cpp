// The fault matrix: every kind and size of fault on every channel, while the machine stands, moves,
// accelerates and cuts, at several rates and updates of the current. Of each cell: when the fault
// is named, that no alarm comes from it, and that the chatter and the contact of the same record
// are found afterwards, each by one alarm. The usual run looks at every fault in every state at one
// rate, --nightly at all of them.
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "faults/base_record.hpp"
#include "faults/bench.hpp"
#include "faults/fault_kinds.hpp"

using namespace faults;

namespace {

constexpr std::array kSpeeds = {0.02, 0.0217, 0.05, 0.09, 0.15, 0.25, 0.6, 0.83};
/// Rows before the fault that are heard by every cell: the source looks at 512 for the rate.
constexpr std::size_t kAhead = 700;

struct Outcome {
  double named_after = -1;  // samples
  int false_alarms = 0;
  int chatter = 0, contact = 0;
  std::size_t most_changes = 0;  // of a channel's signal health, in a second
  std::string ended;             // with this error
  std::string first_false;
};

/// A record, and the stack that has heard of it up to `start`.
struct Base {
  Rows rows;
  std::size_t start = 0;
  std::unique_ptr<HostStack> stack;
  const MachineFile* machine = nullptr;
  StackPlan plan;
  Reporting reporting;
};

/// Of `rows` from `start` on; the fault is on `channel` from row `from` on.
Outcome run(const Base& base, const Rows& rows, std::size_t start, HostStack& stack,
            Channel channel, std::size_t from) {
  Outcome o;
  double since = 0;
  std::map<std::pair<Channel, long>, std::size_t> changes;
  const auto hear = [&](std::int64_t row, const ServoSample<double>&,
                        std::span<const Change> changed) {
    const double t = static_cast<double>(row) * base.reporting.period_s();
    const bool faulty = row >= static_cast<std::int64_t>(from);
    if (faulty) since += 1;
    for (const Change& c : changed) {
      if (c.monitor == MonitorId::signal && faulty)
        o.most_changes = std::max(o.most_changes, ++changes[{c.channel, static_cast<long>(t)}]);
      if (!is_alarm(c)) continue;
      if (c.monitor == MonitorId::chatter && t >= kChatter_s && t <= kExit_s) {
        ++o.chatter;
      } else if (c.monitor == MonitorId::collision && t >= kContact_s) {
        ++o.contact;
      } else {
        ++o.false_alarms;
        if (o.first_false.empty()) o.first_false = text_of(c, t);
      }
    }
    const bool spindle = is_sick(stack.spindle_health().state().state);
    const bool x = is_sick(stack.axis_health(0).state().state);
    const bool named = channel == Channel::spindle ? spindle
                       : channel == Channel::x     ? x
                                                   : spindle || x;
    if (faulty && named && o.named_after < 0) o.named_after = since;
  };
  o.ended = listen(rows, start, *base.machine, stack, hear);
  return o;
}

class Bench {
 public:
  explicit Bench(unsigned seed) : seed_(seed), machines_(seed) {}

  const Base& base(State state, double speed, std::size_t reporting) {
    const auto key = std::make_pair(std::make_pair(state, speed), reporting);
    auto& slot = bases_[key];
    if (slot) return *slot;
    slot = std::make_unique<Base>();
    Base& b = *slot;
    auto& plant = plants_[key.first];
    if (!plant)
      plant = std::make_unique<Plant>(course_of(state, speed),
                                      100 * seed_ + 2 + static_cast<unsigned>(plants_.size()));
    b.reporting = kReporting[reporting];
    b.rows = rows_of(*plant, b.reporting);
    b.machine = &machines_[reporting];
    b.plan = detection::good(plan_stack(*b.machine, signals_of(b.reporting)), "plan");
    b.start = static_cast<std::size_t>(kFault_s * b.reporting.rate_hz()) - kAhead;
    b.stack = std::make_unique<HostStack>();
    prepare(*b.stack, b.plan);
    Rows before(b.rows.begin(), b.rows.begin() + static_cast<std::ptrdiff_t>(b.start));
    const Outcome o = run(b, before, 0, *b.stack, Channel::machine, 0);
    CHECK(o.ended.empty() && o.false_alarms == 0);
    if (o.named_after >= 0) ++accused_;
    if (o.false_alarms > 0 || o.named_after >= 0)
      std::printf("  %s at %g m/s, %s: %s\n", name_of(state), speed, b.reporting.text().c_str(),
                  o.first_false.c_str());
    return b;
  }
  /// Records that were called faulty before there was a fault.
  [[nodiscard]] std::size_t accused() const { return accused_; }

 private:
  unsigned seed_;
  std::size_t accused_ = 0;
  Machines machines_;
  std::map<std::pair<State, double>, std::unique_ptr<Plant>> plants_;
  std::map<std::pair<std::pair<State, double>, std::size_t>, std::unique_ptr<Base>> bases_;
};

struct Tally {
  std::size_t cells = 0, named = 0, late = 0, alarms = 0, missed = 0, repeated = 0, ended = 0,
              noisy = 0;
  double worst = 0;  // samples
};

/// A summary of health a second is bounded: what goes on comes once and goes once.
constexpr std::size_t kMostChanges = 4;

/// A kind of fault on a channel: a line of the page.
struct Line {
  Part part = Part::rows;
  std::string kind;
  Channel channel = Channel::machine;
  std::vector<const Fault*> sizes;
};

std::vector<Line> lines_of(const std::vector<Fault>& faults) {
  std::vector<Line> lines;
  for (const Fault& fault : faults) {
    for (const Channel channel : channels_of(fault.part)) {
      auto line = std::find_if(lines.begin(), lines.end(), [&](const Line& l) {
        return l.part == fault.part && l.kind == fault.kind && l.channel == channel;
      });
      if (line == lines.end())
        line = lines.insert(lines.end(), {fault.part, fault.kind, channel, {}});
      line->sizes.push_back(&fault);
    }
  }
  return lines;
}

/// Of every cell of the whole matrix.
template <typename Cell>
void for_cells(const Fault& fault, Channel channel, Cell&& cell) {
  for (const State state : kStates) cell(state, 0.41);
  if (fault.speeds && channel != Channel::spindle)
    for (const double speed : kSpeeds) cell(State::moving, speed);
}

/// What the page says: what is asserted of the whole matrix.
std::string page(const std::vector<Line>& lines) {
  std::string text =
      "| fault | of | on | sizes | cells | named within | later | alarms | missed | repeated | "
      "shift |\n"
      "|---|---|---|---|--:|---|--:|--:|--:|--:|--:|\n";
  for (const Line& line : lines) {
    std::string sizes, named;
    std::size_t cells = 0;
    for (const Fault* fault : line.sizes) {
      sizes += (sizes.empty() ? "" : "; ") + fault->size;
      const std::string when = fault->named.text();
      if (("; " + named + ";").find("; " + when + ";") == std::string::npos)
        named += (named.empty() ? "" : "; ") + when;
      for_cells(*fault, line.channel, [&](State, double) { cells += kReporting.size(); });
    }
    if (line.part == Part::nothing) named = "never";
    const Open open = open_of(line.part, line.kind, line.channel);
    char counts[120];
    std::snprintf(counts, sizeof counts, "%zu | %zu | %zu | %zu | %zu", open.late, open.alarms,
                  open.missed, open.repeated, open.shift);
    text += "| " + line.kind + " | " + (line.part == Part::nothing ? "" : name_of(line.part)) +
            " | " + name(line.channel) + " | " + sizes + " | " + std::to_string(cells) + " | " +
            named + " | " + counts + " |\n";
  }
  for (const Open& open : kOpen)
    text += (&open == kOpen.data() ? "\n- " : "- ") + open.kind + ", " + name_of(open.part) +
            " of " + name(open.channel) + ": " + open.reason + "\n";
  return text;
}

std::string contents(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct Options {
  bool nightly = false;
  unsigned seed = 12;  // 1 to 11 served development
  std::string failing;
};

class Matrix {
 public:
  explicit Matrix(const Options& options) : options_(options), bench_(options.seed) {
    if (!options.failing.empty()) bad_.open(options.failing);
  }

  void run_line(const Line& line) {
    Tally tally;
    for (const Fault* fault : line.sizes)
      for_cells(*fault, line.channel, [&](State state, double speed) {
        for (std::size_t r = 0; r < kReporting.size(); ++r)
          if (options_.nightly || line.part == Part::nothing || r == turn_ % kReporting.size())
            run_cell(*fault, {state, kReporting[r], speed, line.channel, 0}, r, tally);
        ++turn_;
      });
    // All records have been heard then.
    if (line.part == Part::nothing) tally.late += bench_.accused();
    const Open open = open_of(line.part, line.kind, line.channel);
    std::printf("  %-22s %-8s %-8s %5zu cells, %5zu named, after %g samples at most",
                line.kind.c_str(), name_of(line.part), name(line.channel).c_str(), tally.cells,
                tally.named, tally.worst);
    const auto count = [](std::size_t n, const char* what) {
      if (n > 0) std::printf(", %zu %s", n, what);
    };
    count(tally.late, "NOT IN TIME");
    count(tally.alarms, "with false alarms");
    count(tally.missed, "missed an event");
    count(tally.repeated, "with repeated alarms");
    count(tally.ended, "ENDED");
    count(tally.noisy, "TOO MANY WORDS");
    std::printf("\n");
    std::fflush(stdout);
    const auto holds = [&](bool ok, const char* what) {
      check::that(ok, (line.kind + " of " + name(line.channel) + ": " + what).c_str(), __FILE__,
                  __LINE__);
    };
    holds(tally.late <= open.late, "named in time");
    holds(tally.ended == 0, "goes on");
    holds(tally.noisy == 0, "is told briefly");
    holds(tally.alarms <= open.alarms, "no alarm from it");
    holds(tally.missed <= open.missed, "true events found");
    holds(tally.repeated <= open.repeated, "one alarm each");
  }
  [[nodiscard]] std::size_t cells() const { return cells_; }

 private:
  void run_cell(const Fault& fault, Place p, std::size_t reporting, Tally& tally) {
    const Base& base = bench_.base(p.state, p.speed, reporting);
    Random random(static_cast<unsigned>(100'000 * options_.seed + cells_));
    p.from = static_cast<std::size_t>(kFault_s * p.reporting.rate_hz()) + random() % p.rows(0.015);
    Rows rows = base.rows;
    fault.spoil.apply(rows, p, random);
    auto stack = std::make_unique<HostStack>(*base.stack);
    if (fault.from_the_start) {
      prepare(*stack, base.plan);
      p.from = 0;
    }
    const Outcome o =
        run(base, rows, fault.from_the_start ? 0 : base.start, *stack, p.channel, p.from);
    ++cells_;
    ++tally.cells;
    std::string what;
    const auto wrong = [&](std::size_t& count, const std::string& text) {
      ++count;
      what += (what.empty() ? "" : "; ") + text;
    };
    const auto due = fault.named.at(p);
    const double after = o.named_after;
    if (after > 0) {
      ++tally.named;
      tally.worst = std::max(tally.worst, after);
    }
    if (!o.ended.empty()) wrong(tally.ended, "ended: " + o.ended);
    if (fault.part == Part::nothing && after > 0) wrong(tally.late, "called a fault");
    if (due && after < 0) wrong(tally.late, "not named");
    if (due && after > *due) wrong(tally.late, "named after " + std::to_string(after) + " samples");
    if (o.false_alarms > 0)
      wrong(tally.alarms, std::to_string(o.false_alarms) + " false alarms, " + o.first_false);
    const bool chatter = o.chatter > 0 || (fault.blinds && p.channel == Channel::spindle);
    const bool contact = o.contact > 0 || (fault.blinds && p.channel == Channel::x);
    if (!chatter || !contact)
      wrong(tally.missed,
            std::string("missed") + (chatter ? "" : " chatter") + (contact ? "" : " contact"));
    if (o.chatter > 1 || o.contact > 1)
      wrong(tally.repeated, std::to_string(o.chatter) + " alarms of chatter, " +
                                std::to_string(o.contact) + " of contact");
    if (o.most_changes > kMostChanges)
      wrong(tally.noisy, std::to_string(o.most_changes) + " changes of health in a second");
    if (!what.empty() && bad_.is_open())
      bad_ << name_of(fault.part) << " | " << fault.kind << " | " << fault.size << " | "
           << name(p.channel) << " | " << name_of(p.state)
           << (p.state == State::moving ? " " + std::to_string(p.speed) : "") << " | "
           << base.reporting.text() << " | " << what << "\n";
  }

  Options options_;
  Bench bench_;
  std::ofstream bad_;
  std::size_t turn_ = 0, cells_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  Options options;
  bool print = false;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--page") == 0) print = true;
    if (std::strcmp(argv[i], "--nightly") == 0) options.nightly = true;
    if (i + 1 == argc) break;
    if (std::strcmp(argv[i], "--seed") == 0)
      options.seed = static_cast<unsigned>(std::atoi(argv[++i]));
    if (std::strcmp(argv[i], "--failing") == 0) options.failing = argv[++i];
  }
  const std::vector<Fault> faults = all_faults();
  const std::vector<Line> lines = lines_of(faults);
  const std::string table = page(lines);
  if (print) {
    std::printf("%s", table.c_str());
    return 0;
  }
  CHECK(contents("docs/faults.md").find(table) != std::string::npos);
  Matrix matrix(options);
  for (const Line& line : lines) matrix.run_line(line);
  check::figure("cells", static_cast<double>(matrix.cells()));
  CHECK(matrix.cells() >= (options.nightly ? 3000U : 300U));
  return check::done();
}
