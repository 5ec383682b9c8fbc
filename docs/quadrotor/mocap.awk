function n() { return sqrt(-2*log(1 - rand()))*cos(6.283185307*rand()) }
BEGIN { FS = ","; srand(3); print "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad" }
NR > 1 { printf "%s,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", $1, $2+3e-4*n(), $3+3e-4*n(), $4+3e-4*n(), $8+9e-4*n(), $9+9e-4*n(), $10+9e-4*n() }
