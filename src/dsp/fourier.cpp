#include "dsp/fourier.hpp"

#include <unsupported/Eigen/FFT>

namespace servosense {

namespace {

Eigen::Index size_of(const auto& values) { return static_cast<Eigen::Index>(values.size()); }

}  // namespace

struct FourierTransform::Tables {
  Eigen::FFT<double> whole;
  Eigen::FFT<double> half{Eigen::default_fft_impl<double>(), Eigen::FFT<double>::HalfSpectrum};
};

FourierTransform::FourierTransform() : tables_(std::make_unique<Tables>()) {}
FourierTransform::FourierTransform(FourierTransform&&) noexcept = default;
FourierTransform& FourierTransform::operator=(FourierTransform&&) noexcept = default;
FourierTransform::~FourierTransform() = default;

void FourierTransform::forward(std::span<const double> samples, std::vector<Complex>& lines) {
  lines.resize(samples.size());
  tables_->whole.fwd(lines.data(), samples.data(), size_of(samples));
}

void FourierTransform::forward(std::span<const Complex> samples, std::vector<Complex>& lines) {
  lines.resize(samples.size());
  tables_->whole.fwd(lines.data(), samples.data(), size_of(samples));
}

void FourierTransform::inverse(std::span<const Complex> lines, std::vector<double>& samples) {
  samples.resize(lines.size());
  tables_->whole.inv(samples.data(), lines.data(), size_of(lines));
}

void FourierTransform::inverse(std::span<const Complex> lines, std::vector<Complex>& samples) {
  samples.resize(lines.size());
  tables_->whole.inv(samples.data(), lines.data(), size_of(lines));
}

Eigen::VectorXcd FourierTransform::forward_half(const Eigen::VectorXd& samples) {
  Eigen::VectorXcd lines(samples.size() / 2 + 1);
  tables_->half.fwd(lines.data(), samples.data(), samples.size());
  return lines;
}

Eigen::VectorXd FourierTransform::inverse_half(const Eigen::VectorXcd& lines) {
  Eigen::VectorXd samples(2 * (lines.size() - 1));
  tables_->half.inv(samples.data(), lines.data(), samples.size());
  return samples;
}

std::vector<std::complex<double>> fourier_lines(std::span<const double> samples) {
  std::vector<std::complex<double>> lines;
  FourierTransform().forward(samples, lines);
  return lines;
}

}  // namespace servosense
