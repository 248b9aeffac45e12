// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/sh.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

constexpr std::size_t kCoefficients = kShBasisCount - 1;

std::array<double, 16> basis_at(const Vec3d& direction) {
  std::array<double, 16> basis;
  sh_basis(3, direction, basis.data());
  return basis;
}

/// The angles of a direction, and the 16 values there by the textbook definition, in Python's math:
///
///   Y_l^m = N sqrt(2) P_l^|m|(cos theta) * (cos(m phi) for m > 0, sin(|m| phi) for m < 0),  Y_l^0 = N P_l
///   N = sqrt((2l+1)/(4 pi) (l-|m|)!/(l+|m|)!),  P_l^m with the Condon-Shortley sign (-1)^m,
///
/// and P_l^m(x) = (-1)^m (1-x^2)^(m/2) d^m/dx^m P_l(x), differentiated by its coefficients. In
/// order of l, then m = -l..l.
struct KnownBasis {
  double theta, phi;
  std::array<double, 16> values;
};
const KnownBasis kKnown[] = {
    {0.6,
     1.1,
     {0.2820947917738781, -0.2458713938497454, 0.4032610546078099, -0.1251406974601926,
      0.1408107725494266, -0.4537572651493740, 0.3291226516749397, -0.2309479754815366,
      -0.1024955665546994, 0.0167556870542473, 0.3074790194504621, -0.5533355696802287,
      0.1250137328780533, -0.2816301564615242, -0.2238126794680873, 0.1048897219468178}},
    {1.9,
     -2.3,
     {0.2820947917738781, 0.3447876920401323, -0.1579600944415147, 0.3080624459740423,
      0.4860935075164897, -0.2492461426511615, -0.2165010344610784, -0.2226975559956314,
      -0.0548627440475526, 0.2892203705615307, -0.4157770656300032, -0.1539769575594037,
      0.2988858085703727, -0.1375760192851372, 0.0469265077187387, -0.4078632387663191}},
    {2.8,
     0.4,
     {0.2820947917738781, -0.0637384566989995, -0.4603722024217551, -0.1507556268031656,
      0.0439748514668443, 0.1342888464613882, 0.5246061871959501, 0.3176229904116651,
      0.0427090178060351, -0.0206731452399401, -0.1096242912720399, -0.2050345140691415,
      -0.5059441025550546, -0.4849522295581579, -0.1064687122693655, -0.0080372965038702}},
};

TEST(ShBasis, AgreesWithLegendrePolynomials) {
  for (const KnownBasis& known : kKnown) {
    const Vec3d d{std::sin(known.theta) * std::cos(known.phi),
                  std::sin(known.theta) * std::sin(known.phi), std::cos(known.theta)};
    const std::array<double, 16> basis = basis_at(d);
    for (int k = 0; k < 16; ++k) EXPECT_NEAR(basis[k], known.values[k], 1e-14) << "basis " << k;
  }
}

TEST(UnitDirection, PointsFromTheFirstToTheSecondPoint) {
  const Vec3d d = unit_direction(Vec3d{1.0, 2.0, 3.0}, Vec3d{1.0, 5.0, -1.0});
  EXPECT_NEAR(d.x, 0.0, 1e-15);
  EXPECT_NEAR(d.y, 0.6, 1e-15);
  EXPECT_NEAR(d.z, -0.8, 1e-15);
}

TEST(ShColor, OfZeroCoefficientsIsGray) {
  const std::array<Vec3d, kCoefficients> zero{};
  const Vec3d color = sh_color(3, Vec3d{0.6, 0.0, 0.8}, Vec3d{0.0, 0.0, 0.0}, zero.data());
  EXPECT_EQ(flatten(color), (std::array{0.5, 0.5, 0.5}));
}

TEST(ShColor, ReadsOnlyTheCoefficientsOfItsDegree) {
  std::array<Vec3d, kCoefficients> rest;
  for (int degree = 0; degree <= 3; ++degree) {
    const int used = (degree + 1) * (degree + 1) - 1;
    for (int k = 0; k < int(kCoefficients); ++k) rest[k] = Vec3d(k < used ? 0.0 : std::nan(""));
    EXPECT_EQ(sh_color(degree, Vec3d{0.6, 0.0, 0.8}, Vec3d{0.0, 0.0, 0.0}, rest.data()).x, 0.5);
  }
}

}  // namespace
}  // namespace gs
