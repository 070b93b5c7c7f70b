"""Sheen of Microfiber: its albedo and shape, on the grid of cosine and roughness that Cycles uses.

The values were measured: `tests.addon.against_cycles.sheen_table` lets Cycles (Blender 5.0) light planes of the Sheen
BSDF by suns, solves for the three numbers at each node, and prints this text. They are those that the authors of the
model have fitted to light traced through layers of fibres.

References
----------
T. Zeltner, B. Burley, M. J.-Y. Chiang, "Practical Multiple-Scattering Sheen Using Linearly Transformed Cosines",
SIGGRAPH Talks 2022.
"""

from __future__ import annotations

import base64
import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

SIZE = 32
# Values are multiples of this.
UNIT = 1e-5

# zlib, base85: little-endian int32 differences along roughness, then along the cosine, of (albedo, a, b).
PACKED = (
    r"c-qC92b5J+mWJ=EB1jShBnm1ZXp4v_5(Gra3W6viihxZL&{jcOl!n1>Q5!G-ii(Y`fS3ppEI?=^7pbAJ3Mfi~6gihjuHwD<|GD2=^TyRP%UR3Sve"
    r"wVJb>F>b@3Yg{d!L&U1VP(aEEW}l-{4>QGC@%DNG!Ho^mBg$KK73Yf=g3lu~xfcu>pCp*m%+3FI*HZ#lnAn?&ssL_3x#oL6B7}2zq=Uixu4$iyb}"
    r"_i}e!Wdqro1AkoCm!AoB3fByU5`1$|vc&2g?3@;r7`E_0K$5?FoiCFAv@laCAC?#do(p+B%+lAx8Pv|KRc#i15;Om$2H0AOjNG~1)-xUagrJ88#`"
    r"B-ew*;wq17QI_asHlaH)&079|2<))utUfZend7G6Xf%+`1!wdm?pZFiv+>Kf<bV3au7VM-xg_s#WZOzVX3Z5YVt~&bc@hlzrQUk6w-v<3A~*DnXd"
    r"A%=SvB6{dWW&eQ#}25DdC32#$)6D*1w7mVWd@1N2f8O>j~4hiL4fzazRoM<}9q&F2{5YvG@Q%qNyD91~6@@REys@)GPhPTThyiQbP=ep%6PD*7LZ"
    r"pN0DEHrt<GcuqK}2m5GTBUIDNe-#c1jr7dZ!USQKuu(`yCWnNR$mT5k<TA#2F`A231<{`?+A}5pg`&SoJXO^F&iegM(YaSxpob3$xx&l(d#;cpl+"
    r"`o$2`>n533G)N!gug-03SMuj?Vl{Hva9H=sqL*r8Tw}{g*_)uVB7gTb`oxtk6a1EOZpU5K@JRelI1o5(c7^kAxY*Kak1y;0QjHgN`l;DZ*W%`=C%"
    r"r*dw}K#lyQ=|9U~8A?T=QY6{y}v*rJl@VRhK$gkh(3%3hT34?@>f$ek&vBWa@LD+*VjtYOV+(hq7(asg^n!28#v6C=ev>y@X>zS{hQB9~J>=fN%o"
    r"=;<8+mp~#u-*Jg7?2=~xe0u%6Sg7`>t>4ZvS?lqy@?vrtb3uAkR{rsHCE7QUMC9I3Xcd^3wH};;HQ~zJ@+~YgOSBhVUqBr@VT%Qy<`fj@tKLD(OI"
    r"--YfLd8LO&r*bn6K}2nx-yy~29o55jQa8tB+gTL^7zukg^B=e(c1B>Y*>HWQnM&(0B632z8VqWz8NZ594x{R^{1^FEEg*En8iD0C3E5qG8weS}WJ"
    r"-&ubzXqu;%!U*9}WH1)_O~fwdGujrKi%v1|Fj!+X;cnqxVUp<8*4RwrU?Iu-B{r;(87yGlCiwrm!V|)C(C#LTgRl3I!5h#uPqT@IALzff!VAKKLb"
    r"~o<5>kbSg)Kr?;YHzT!SVk!$1YuK+m5Xf{saFTCXB+a&CiSI-Lm={_g`U8d)@p7A-&O}n<QK%90)=b&~=8!M}>EUJB9kbFI;CHiF1>PWsC8Xv8-_"
    r"%@*WE9*WqafzF~ZbeO)eECp4Z7Liw-II7Zki%oc_Vj|+7K^Lzq(bSyt@f5gY<z()%9HWfMhx98#KGvQP0W~AjQRJEQXq0C<veiBv-2Zip!P<-Jzp"
    r"_XvFb2p)&_X=SXaXy>5Q-x*1C&a+f!dmS13wW~c?{th4-6a~gqx0+_^u6)u`_IB0p`FlQ=n{lBS<~{-95*r+*7#$>o@~s+#%-S&=xP!%$ucV_+Pn"
    r"4MN#SqyFJZFqEP8SL+b2AT{dHyCzHj?0BzS+ViGP>}rBlIf;*7SH!27fP)-pOs9JU;s^E%GFs%Mt5X3Jv|bp9&L#Qqv1AIHI2=%SqPHnHi-Ak5(k"
    r"!I$H_(u&{^Iype>%0&;k$mB`UU#{oA7Dk}w&)}yg>wHTXD^x}go_Amn?$K?8ZrFqMZ(H#Cnv&y`()f+WvbJ%r51T#69(+0y(pe+)!N%VL9kE5P>m"
    r"NZVr>DRbLT{nEaJ6ucaEoAi*9c{~UySQ)_Pmn1u7rH9H9wJ%MnB~JHugRmo!cfxk-OcYv9)t{Y|#8&&vP||$Al)rUED8=Jyb$pju9$%f-H?UlYiY"
    r"Kqp=VEK^THvcM>eWFNFrK&(Oo0LVKY(dx7<Qzi<QZT!}usE^X&Q4|wr!&NUjMlYIECd2Emr+S+tzcVtel^FH1kN&Gke_oJIf;lnha5v<Gp=%67np"
    r"*-uZf{bj#O7(*ltlifml0w^gl4l-djwkW`4$$yC6X4CZ+nV2AL*{XsRfrokkxvusrxyG?K@6>reY6w(R>ZYF=%Fn5o$wHP@NW^;+!Z}|Ke(6q24j"
    r"nl<AaV>wb9+{&@)et*<Rz#@cd#@XiIgmySl{srubQNV*LXeUqJ5Vn0F97JjDIB>`VEGRrj!0l|}abiKX_1yV3Rg63zz-U>oI7!(^Q6m89OJg%*(k"
    r"oz=KX6I`zaj!{7CEy8s)rpkD((tB?Rr^SC^y`Oh$5DZXonjj}@;yOz6b&)cr$uO#FtSqH9E}^(8#lNTDA33Z%S^~>+o*{<&UifYL56;6K?<$M_6-"
    r"sRCmH+qBAE~vkkqrAuE>YnDIaxW$#Cfj${k&v5M*+2voV=rSQ}dc%mwsW<|Gnsqh=egNpL4fp7^J<AxA1Se?jZdY)%7((;b@pgjMu&9(q$Xj!ND!"
    r"c3$-B(QviPF{4dw#I=w$262^g3kucxr$zI_)`>kl0r!Us{viEI0(>^b>(eBRobiGM)j1e!RMfXn4vqO&asqFBNN><xxqWKyJ$tlZ8*%h_kX+;%FW"
    r"RpGQ2&?sOviD%Umnt+Bp3vW4!Jp&iQEJ_T8q1TT43nN*n~c)EO#S_d{=TGl&xsHFe_7WMx^5T=ZOgUY2GP#Z-<IpODnuLmo#Zgr+U}fN@7EK?>-q"
    r"uVd-mjSs9SromtW}`DjLSm-PDJk({<ok-JcQ-<?o!Usc1OH^w7PAx^5;O%F8F)$%nHgyP^8~3embvcuklpG$to<-20R`QkNJuo&2^Fy#(hp4^SJr"
    r"W^g`!e=O9Mdqqb?*ZatVXjpeUKcA-S)`Ii??)k$ycY$N0?H$>rkc&7rz6<>(#IAwF-_C+_*k{RS7DdC}!VGGzuIzVL@VEDsG43aL57xNUd!XXmIA"
    r"|6mCax87*l)TKHyvXiAl^Hta%|6m#)stMO^LI%UH1+8lk@*qjE;tViE8vnTqj*8njeY2b5O_cGvo(T$wTG|e__s6<O2Q4!%C1#IkuN%FZnxt1&^*"
    r"9onLwna~|qF<LhXc`|Xt-v=Pno`uiF!y1TBOBRh|5%zoRC+-n&7toPe$<P7b|{o1nEIRAEiajSLZm|?rs=(>HT#wz3%&L4)j-qrPzXxK-)T)uk2`"
    r"DMHpBpid^j?_S1$ZHxxuPXUp4R|eweVl`qYkTW5gF0gw^{VSu%W*Ar=pB|%p>PkV#ykOeLM`^rs^pnX$w6-A_e$hYSMgpEa?hgFAkOiM!c!*s{^5"
    r"AdL$APj@_Nx<3|}{}A6cLFoo3V)H<QaWBX4jXQ3f88iBUzdyEx5UV#Xfw{e#$@eZzHoZ)(Jgg~GgjB<rz^E@$ol9T!K=mB`JmW35+F>r^F2IZ1Et"
    r"JiV<;^lOXLLs|e2Z_rPE)jB8~=6NlduOu~nF7-=1=c<97mBjXIQEwF>zbi$qT@+p}qJ!hq-ZAR2bY$`z{g?E@|D97`MxMW$*i}A3r@v$UHQ=)haw"
    r"(47PSDFZ1@AlQukFI#7gK-EAU4jV{u)*!%!ezmt{m#4&D87#(Q65GP$of6<@hZ>_ICmK=R*4o@xbf;0C}#X|1p<dK=q>G`|*1E5dN|^q1V0)-Fl7"
    r"166(x?$R`G$@qVhGIZbcm618th;?R8jVK}|O)S}^fuEuWT{n2#j&rIkYe#`v>@DuNS#QXX7h4Tr#euqwW@to-wKz=9aAwF0v%#V|)qfa6CrSQ2J|"
    r"4E^*oH(xJnO&S2?M3d{$lf|jgTKT0#Rlx4JaHmf3fzp0zNc@p9+@v^Tmr2X^it;2^It`OBZGG~aXlLz(&_i^z^2dfUc3k3{p4}c|D1JB$0p|?tA+"
    r"GPQ;<gncC#H`cA&$h@OXe;+;Mo^g3fFs%UHuscuK=BUJ?Bl=-*ACH#HR=;xdTKe;)jAV6Tez*E4x;D{=07p8F0tEFm6c@tb>*_G9;A+lqb{;^8><"
    r">yO}LL4qtYS^qlt+6nEQtoab{EQCe|Ydni>e2q<7Zq8#~<^DIt!d#&%J@fZ@b}~K0#mI3jbT@Oo1e@AKtXhkGZ6?0u@!K?ftrYvA<Mn3z)bA7$ef"
    r"O*D5syFQoNWQ?{)YbP8f<$LI^6~?p#LbglEd1MVFz3A{mIDd40h&y+PbPB|My<lg`DU;=zU7>a68DPx4EA=e!|Z`N;voWfnMMsbRF+~IafG|E~dc"
    r"WPuS3n3Y<PKXiJZB7{0U|`$^@U1@ukU5=&NMV}*$MS*-mX^1aeLdkCGLz&`5|r&I99I}3;U@6H*PX}yW<Y{#DRu(MUfnuEle!^q_bc2b6X*YRy7c"
    r"372s<s|;<^N9AuJKIKe&J>b-#z~&nCK~o7=ZbJeIcbY%NZ&n>sd~;mp?<oTq3bSsZl<mugML}P<DQcDOxG|zo2%~Lvi(E%AJseOw1H%6gMLA4_u1"
    r"M8;qIj1H~IIl&$$bPeg5m5D@6ajeTbeip4qa&<<7zN_afn2;d#lamSj?2<4v4{*hg=V{JQjCk`X<t7<iLpkUtXEd+x=4Lf_AJ<Lhk6<#GF)dt|!y"
    r"nMoBrU%=;}z9z<0kzuvC^vh*fT|p%(Cz^FxnA5rUF_a!a3-X(I4r>4N`HE|@Hu#c#YlnE)%zkP!inym64bO}Bldt&Og2s-k`t1hkJoB=!PdZypXd"
    r"8$qfjN>K_9EMm@83$!?_Svfa!SXsO4LT##Gu;ryd8Jkr!C=F9trbWpND=ZJ_?HYRnaj2>yZ@lpQih+`^uaT&k|?onc<PJ-t9u&*9-oK&|9?ct!M3"
    r"7!~*Bz#o^8Sb3W1WImSrGTFtjG8um{tyMbC`68Zi>@!<sNkOJBc`Rzs#>Y(4<=NUvl@($31+T$T)bCKGz8+}^W%x|(U`7A9pFN}9J{oRD<`0UAgn"
    r"M7}?ek9D@UvVz4_21|7b)PRJhiAaY>AAL~_Pvo_XC>}6q8_e5JyL;QeQnMt-;9K|>p1LO|G4I#>R7{B(Nq3*z<my%>5JFKu8lRW)IFca_l|^q(2G"
    r"8JyszH~IoyOC$}-l*R&zK5F|W__yX~^F=3C7^a~C<-WcoGk4ZP1s5&o`VSW?)Rznycj0rZ?3(SxW1YU3m2sLLyI-?Y6a^dt{2P2a{n7Vja}RXLwM"
    r"k(;_FvRw3^HXnk0{VCCRudOs^(Y>*~n$$|SL$e-rc?;GWx0f5pGup8ym7zz_fm+49d(W_~JLdZPl3jdL@oF@b(Mi#+7YY4&3TFa+pxGWBw4fHOk<"
    r"cS3!u<y5ESWm;7Ia^XxZ!wp$Y;Bv_ea70>AqSn-*@<%4*R3~WA00(a4y&t-|R~*Q3big`D%&1)`ISB+)suF#|@vE+~T@L54a9l6Ak-|E~fnLm%qC"
    r"@9SzUUz3y6(@LX;_=L7Nnf4s-_1bVMPtQ<hS*be(FPXA^X=RnRaD{{s?ky^;#mQ=?s`tlt`3GzqBm1Ue$Pr=THa9%Q(-cFQ$*lnCa4TiVJ=vCc_{"
    r"W@2(EGzmu1^m?UuMXb|bmrWC47A@SFCWeM`Nzm38C$GRzw8y(-H@1liC)xB-Z?>T=6JG%8f8i(ta%?w_=cx1dE6p$&?)4_3&_EilAqN@*BQi|Cpd"
    r">0gbZ3^m(NhQH=swcH6ecco0~IyM>PmcBWHYvJaaWU_bTG+Wb*JUv9EN_l*&WD6TQ)H<PDYa`{~FgKefAa&}K>D9P^<265npjAqU?|4X_4z{XpKE"
    r"%6V#px$Drg`i$JZ6g`tCvB??eqcL`xOuaujDU7E}IhUWzHx#p}6Fx`od#SxL$>}rM`!<n-A7ecFv-AH##OuoB8+T!s9f(K8lSBX5MQ`S7*6;zf)E"
    r"CfOj4XCg!yTc1$mHHxV)`lSlYm~tQF81UdBaBX`EtaNkCVf_Wgm6zB7E&r#<kF1$h=?BQ`riCMfmpOFns<*FYqY&$~khP)6`?}eqn@OP=kCS{fpS"
    r"vY{q5iVLo!-f*l;AE<Az{WV7zW)GKGPkIU$1N8m5sqspNNW8FEQJf1J?-R41aA+^yW*1ZxR+zGvH*kHW2%Al@11aEs1#^VX!L#9(ZorcG`*!rmap"
    r"<nK!-dmN>dsu*dZ9*=qp}QlYE={K<jemc+pIYxQHDLxea1K7RSWh}V;D!al{o^G1Tta+VoL~=Yx!w*hX<#dB+J+r|m(Zv9Cw%NcUMt{jAvQjiZ^p"
    r"hY5av`l%)O3h<7-_HUz_pyG}gKuo7e#TRMwxt+BP%SCSpgtZ!ib@@i$ujey~x&aBn&a@9E6BkvY;6uCqY=8^Uzn*$OWkS$7tEr-Bq{&clY^V?S}O"
    r"F{)q~3v;lUEY_Ad|8C@%&RXO8-^TNsc`l7-Rv^2T=rR?#f64wej<cbWqCc--m<OLDp6#KJwhwvk#rAjOb9<40{N9!XUeb_3T7n)I;m6YxdOOea&1"
    r"_52|4&CNS|<"
)


def pack_table(table: NDArray[np.float64]) -> str:
    """Return `PACKED`, in one piece, for a table (3, roughness, cosine)."""
    numbers = np.rint(table / UNIT).astype(np.int64)
    steps = np.diff(np.diff(numbers, axis=1, prepend=0), axis=2, prepend=0)
    return base64.b85encode(zlib.compress(steps.astype("<i4").tobytes(), 9)).decode()


@lru_cache(maxsize=1)
def sheen_table() -> NDArray[np.float64]:
    """Return (3, SIZE, SIZE) by roughness and cosine, each from 0 to 1: the albedo, and a and b of `diffuse`."""
    steps = np.frombuffer(zlib.decompress(base64.b85decode(PACKED)), dtype="<i4").reshape(3, SIZE, SIZE)
    return np.cumsum(np.cumsum(steps, axis=2), axis=1) * UNIT
