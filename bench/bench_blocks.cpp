// What each real-time block costs per sample on this computer, beside the batch computation that it
// replaces.
//   bench_blocks [--csv] [--quick] [--check]
// --csv prints `block,mean_ns,p9999_ns,worst_ns,budget_percent`; --quick takes two seconds;
// --check ends with status 1 when a recursive block is not several times cheaper than its rival.
// Times are of the machine they were taken on. The worst call and, on a busy computer, the 99.99th
// percentile show the operating system, not the block.
#include <cmath>
#include <complex>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <unsupported/Eigen/FFT>
#include <vector>

#include "blocks.hpp"
#include "harness.hpp"

#ifdef SERVOSENSE_FFTW
#include <fftw3.h>
#endif

namespace {

using bench::Sample;

constexpr double kBudget_ns = 125e3;  // 8 kHz
constexpr std::uint32_t kSamples = 2048;

struct Options {
  bool csv = false;
  bool quick = false;
  bool check = false;
  double budget_ms() const { return quick ? 15 : 100; }
  std::size_t calls() const { return quick ? 100'000 : 1'000'000; }
};

struct Row {
  std::string name;
  double mean_ns = 0;
  bench::Tail tail;
};

struct Bench {
  Options options;
  std::vector<Sample<float>> samples;
  double empty_ns = 0;
  double count_ns = 0;
  double counter_ns = 0;
  std::vector<Row> rows;

  explicit Bench(Options o) : options(o) {
    bench::CutSignal<float> signal(kSamples, false);
    for (std::uint32_t i = 0; i < kSamples; ++i) samples.push_back(signal.next());
    count_ns = bench::ns_per_count();
    counter_ns = bench::counter_cost_ns(count_ns);
    empty_ns = mean(bench::EmptyCase<float>{});
  }

  // ns per sample with the empty loop's taken out.
  template <typename Block>
  double mean(Block&& block) {
    return bench::least_ns_per_sample(samples.size(), options.budget_ms(),
                                      [&] {
                                        for (const Sample<float>& s : samples)
                                          bench::keep(block.step(s));
                                      }) -
           empty_ns;
  }

  template <typename Block>
  void measure(const char* name, Block& block) {
    Row row{name, mean(block), {}};
    row.tail = bench::tail_of_calls(options.calls(), count_ns, [&](std::size_t i) {
      bench::keep(block.step(samples[i % kSamples]));
    });
    row.tail.p9999_ns = std::max(0.0, row.tail.p9999_ns - counter_ns);
    row.tail.worst_ns = std::max(0.0, row.tail.worst_ns - counter_ns);
    rows.push_back(row);
  }

  template <typename... Case>
  bool measure_blocks(std::tuple<Case...>*) {
    bool ok = true;
    const auto one = [&](auto block) {
      if (!block->configure().ok()) {
        std::fprintf(stderr, "%s refuses its configuration\n", block->name);
        ok = false;
        return;
      }
      measure(block->name, *block);
    };
    (one(std::make_unique<Case>()), ...);
    return ok;
  }

  double mean_of(const std::string& name) const {
    for (const Row& row : rows)
      if (row.name == name) return row.mean_ns;
    return 0;
  }
};

// The last `size` samples in a row, for batch computations: every sample is stored twice.
class History {
 public:
  explicit History(std::size_t size) : size_(size), twice_(2 * size) {}
  const float* push(float x) {
    twice_[at_] = twice_[at_ + size_] = x;
    if (++at_ == size_) at_ = 0;
    return twice_.data() + at_;
  }

 private:
  std::size_t size_;
  std::size_t at_ = 0;
  std::vector<float> twice_;
};

// The rivals: what one computes without recursion, anew with every sample.
class TwoPassVariance {
 public:
  explicit TwoPassVariance(std::size_t size) : size_(size), history_(size) {}
  float step(const Sample<float>& in) {
    const float* x = history_.push(in.torque_Nm);
    float mean = 0;
    for (std::size_t i = 0; i < size_; ++i) mean += x[i];
    mean /= static_cast<float>(size_);
    float sum = 0;
    for (std::size_t i = 0; i < size_; ++i) sum += (x[i] - mean) * (x[i] - mean);
    return sum / static_cast<float>(size_);
  }

 private:
  std::size_t size_;
  History history_;
};

class EigenFft {
 public:
  explicit EigenFft(std::size_t size)
      : size_(static_cast<int>(size)), history_(size), spectrum_(size / 2 + 1) {
    fft_.SetFlag(Eigen::FFT<float>::HalfSpectrum);
  }
  float step(const Sample<float>& in) {
    fft_.fwd(spectrum_.data(), history_.push(in.torque_Nm), size_);
    return spectrum_[1].real();
  }

 private:
  int size_;
  History history_;
  std::vector<std::complex<float>> spectrum_;
  Eigen::FFT<float> fft_;
};

#ifdef SERVOSENSE_FFTW
class Fftw {
 public:
  explicit Fftw(std::size_t size)
      : history_(size),
        in_(fftwf_alloc_real(size)),
        out_(fftwf_alloc_complex(size / 2 + 1)),
        size_(size),
        plan_(fftwf_plan_dft_r2c_1d(static_cast<int>(size), in_, out_, FFTW_MEASURE)) {}
  Fftw(const Fftw&) = delete;
  Fftw& operator=(const Fftw&) = delete;
  ~Fftw() {
    fftwf_destroy_plan(plan_);
    fftwf_free(out_);
    fftwf_free(in_);
  }
  float step(const Sample<float>& in) {
    std::memcpy(in_, history_.push(in.torque_Nm), size_ * sizeof(float));
    fftwf_execute(plan_);
    return out_[1][0];
  }

 private:
  History history_;
  float* in_;
  fftwf_complex* out_;
  std::size_t size_;
  fftwf_plan plan_;
};
#endif

template <std::size_t Window>
struct VarianceOf {
  bench::MovingVariance<float, Window> block;
  VarianceOf() { block.configure({Window}); }
  float step(const Sample<float>& in) { return block.process(in.torque_Nm); }
};

struct FourierOf {
  bench::MovingFourier<float, bench::kWindow, 32> block;
  explicit FourierOf(std::size_t harmonics) { block.configure({bench::kWindow, harmonics}); }
  float step(const Sample<float>& in) {
    block.process(in.torque_Nm, in.spindle.turn_angle_rad);
    return block.cosine_sum(1);
  }
};

struct ChatterOf {
  bench::ChatterMonitor<float, 8, 32, 2 * bench::kWindow> block;
  explicit ChatterOf(unsigned harmonics) {
    bench::ChatterConfig c = bench::chatter_config();
    c.harmonics = harmonics;
    block.configure(c);
  }
  float step(const Sample<float>& in) {
    return static_cast<float>(block.process(in.torque_Nm, in.spindle.turn_angle_rad,
                                            in.spindle.increment, in.torque_quality));
  }
};

// What the spectrum of the chatter monitor's window, eight revolutions, costs as a transform for
// every sample. The transform alone: neither a taper, which a window needs that is no whole number
// of revolutions, nor powers and their sums are counted.
void print_transforms(Bench& b) {
  const double fourier = b.mean_of("moving_fourier");
  const double chatter = b.mean_of("chatter");
  std::printf(
      "\na transform of the chatter monitor's window for every sample costs so many times as much\n"
      "as the lines of moving_fourier (for every sample) / the chatter monitor (a verdict a "
      "turn)\n");
  for (const std::size_t size : {std::size_t{512}, std::size_t{1024}, std::size_t{2048}}) {
    const double rpm = 8 * 60 / (static_cast<double>(size) * bench::kPeriod_s);
    const double eigen = b.mean(EigenFft(size));
    std::printf("  %4zu samples (%4.0f rpm)   Eigen %6.1f / %6.1f", size, rpm, eigen / fourier,
                eigen / chatter);
#ifdef SERVOSENSE_FFTW
    Fftw transform(size);
    const double fftw = b.mean(transform);
    std::printf("   FFTW %6.1f / %6.1f", fftw / fourier, fftw / chatter);
#endif
    std::printf("\n");
  }
}

// Cost laws: W samples in the window, H harmonics.
void print_laws(Bench& b) {
  const std::vector<double> windows = {64, 128, 256, 512, 1024, 2048, 4096};
  const std::vector<double> variance = {b.mean(VarianceOf<64>()),   b.mean(VarianceOf<128>()),
                                        b.mean(VarianceOf<256>()),  b.mean(VarianceOf<512>()),
                                        b.mean(VarianceOf<1024>()), b.mean(VarianceOf<2048>()),
                                        b.mean(VarianceOf<4096>())};
  std::vector<double> two_pass, transforms, w_log_w;
  for (const double w : windows) {
    two_pass.push_back(b.mean(TwoPassVariance(static_cast<std::size_t>(w))));
    transforms.push_back(b.mean(EigenFft(static_cast<std::size_t>(w))));
    w_log_w.push_back(w * std::log2(w));
  }
  const std::vector<double> harmonics = {2, 4, 8, 16, 32};
  std::vector<double> fourier, chatter;
  for (const double h : harmonics) {
    fourier.push_back(b.mean(FourierOf(static_cast<std::size_t>(h))));
    chatter.push_back(b.mean(ChatterOf(static_cast<unsigned>(h))));
  }
  const auto print = [](const char* name, const char* unit, bench::Law law) {
    std::printf("  %-26s %8.2f %+10.5f %s\n", name, law.fixed, law.per_unit, unit);
  };
  std::printf("\ncost per sample [ns] over W = 64..4096 samples, H = 2..32 harmonics\n");
  print("moving_variance", "W", bench::fit(windows, variance));
  print("two-pass variance", "W", bench::fit(windows, two_pass));
  print("Eigen FFT", "W log2 W", bench::fit(w_log_w, transforms));
  print("moving_fourier, W = 512", "H", bench::fit(harmonics, fourier));
  print("chatter, 8 revolutions", "H", bench::fit(harmonics, chatter));
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--csv") {
      options.csv = true;
    } else if (argument == "--quick") {
      options.quick = true;
    } else if (argument == "--check") {
      options.check = true;
    } else {
      std::fprintf(stderr, "usage: bench_blocks [--csv] [--quick] [--check]\n");
      return 2;
    }
  }
  Bench b(options);
  const bool configured = b.measure_blocks(static_cast<bench::Blocks<float>*>(nullptr));
  TwoPassVariance two_pass(bench::kWindow);
  b.measure("rival: two-pass variance 512", two_pass);
  EigenFft eigen(bench::kWindow);
  b.measure("rival: Eigen FFT 512", eigen);
#ifdef SERVOSENSE_FFTW
  Fftw fftw(bench::kWindow);
  b.measure("rival: FFTW 512", fftw);
#endif

  std::printf(options.csv ? "block,mean_ns,p9999_ns,worst_ns,budget_percent\n"
                          : "block                              mean     99.99 %%       worst    "
                            "mean, share of 125 us\n");
  for (const Row& row : b.rows)
    std::printf(
        options.csv ? "%s,%.2f,%.1f,%.0f,%.5f\n" : "%-30s %8.2f ns %8.1f ns %8.0f ns  %8.4f %%\n",
        row.name.c_str(), row.mean_ns, row.tail.p9999_ns, row.tail.worst_ns,
        100 * row.mean_ns / kBudget_ns);
  if (options.csv) return configured ? 0 : 1;

  const double variance = b.mean_of("rival: two-pass variance 512") / b.mean_of("moving_variance");
  const double fourier = b.mean_of("rival: Eigen FFT 512") / b.mean_of("moving_fourier");
  std::printf(
      "\nmoving variance is %.0f times cheaper than two passes over 512 samples\n"
      "ten moving Fourier lines are %.1f times cheaper than Eigen's FFT of 512 samples\n",
      variance, fourier);
  print_transforms(b);
  if (!options.quick) print_laws(b);
  // Ratios of one run: a fraction of what an idle computer shows, so that load does not decide.
  if (options.check && !(variance > 10 && fourier > 2)) {
    std::printf(
        "the recursive blocks are not as much cheaper than their rivals as they should be\n");
    return 1;
  }
  return configured ? 0 : 1;
}
